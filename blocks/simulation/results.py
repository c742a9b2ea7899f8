"""Results: what was logged, as an `xarray.Dataset` with units, frames and provenance."""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework.errors import (
    DivergenceError,
    SimulationError,
    SimulationInterrupted,
    TrussflowError,
)
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.types import Vector

if TYPE_CHECKING:
    import xarray as xr


CHUNK_ROWS = 1024
"""Rows that a file keeps together; netCDF's own choice, one row, is slow."""

WAITING_NUMBERS = 500_000
"""Numbers that wait in memory before a streamed log writes them; 4 MB."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One logged port, or slice of one.

    Attributes
    ----------
    name : str
        Name of the variable in the result.
    port : Port
        The port of a leaf block, whole or sliced.
    columns : slice
        Where the whole port sits in a logged row.
    dims : tuple of str
        Names of the axes behind time.
    """

    name: str
    port: Port
    columns: slice
    dims: tuple[str, ...]

    def values(self, rows: Vector) -> Vector:
        """Return this channel's part of logged rows."""
        elements = self.port.elements()
        return rows[:, self.columns][:, elements.ravel()].reshape(len(rows), *elements.shape)

    def attributes(self) -> dict[str, str]:
        """Return unit, frame and meaning."""
        found = {"long_name": self.port.declaration.meaning or self.port.path, "source": self.port.path}
        units = self.port.element_units()
        if units and any(u is not None for u in units):
            same = len(set(units)) == 1
            found["units"] = str(units[0]) if same else ", ".join(u or "" for u in units)
        if self.port.frame is not None:
            found["frame"] = self.port.frame
        return found


def channels(ports: Mapping[str, Port]) -> list[Channel]:
    """Lay ports out in one row.

    Axes have the names that ports declare, as long as one name means one size; others are named
    by their size, so that signals of one shape can be subtracted.

    Raises
    ------
    SimulationError
        If a name cannot be used in a result file.
    """
    found, start = [], 0
    sizes: dict[str, int] = {}
    for name, port in ports.items():
        text: object = name
        if not isinstance(text, str) or text in ("", "time") or "/" in text:
            raise SimulationError(
                f"cannot log {port.describe()} as {name!r}: names are not empty, not 'time', and without '/'"
            )
        shape = port.shape or ()
        dims = port.declaration.dims
        fits = len(dims) == len(shape) and len(set(dims)) == len(dims) and not {*ports} & {*dims}
        if not fits or any(sizes.get(d, n) != n for d, n in zip(dims, shape, strict=True)):
            dims = tuple(f"element_{size}" + "_" * shape[:i].count(size) for i, size in enumerate(shape))
        sizes |= dict(zip(dims, shape, strict=True))
        found.append(Channel(name, port, slice(start, start + port.size), dims))
        start += port.size
    return found


def provenance() -> dict[str, str]:
    """Return versions and date, for the attributes of a result."""
    try:
        own = version("trussflow")
    except PackageNotFoundError:
        own = "unknown"
    return {
        "trussflow_version": own,
        "python_version": platform.python_version(),
        "casadi_version": ca.CasadiMeta.version(),
        "numpy_version": np.__version__,
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


class Log:
    """Rows collected in memory."""

    def __init__(self, channels: Sequence[Channel], attributes: Mapping[str, Any]) -> None:
        self.channels = channels
        self.attributes = dict(attributes)
        self.width = channels[-1].columns.stop if channels else 0
        self._times: list[Vector] = []
        self._rows: list[Vector] = []

    def append(self, times: Vector, rows: Vector) -> None:
        """Add rows; the arrays are kept, not copied."""
        self._times.append(times)
        self._rows.append(rows)

    def _collected(self) -> tuple[Vector, Vector]:
        """Return all times and rows that are in memory."""
        times = np.concatenate([np.zeros(0), *self._times])
        return times, np.concatenate([np.zeros((0, self.width)), *self._rows])

    def finish(self, **attributes: Any) -> xr.Dataset:
        """Return everything logged as a dataset."""
        return dataset(self.channels, *self._collected(), self.attributes | attributes)

    def abandon(self, error: BaseException, t: float, **attributes: Any) -> None:
        """Finish after an error; ours gets what was logged as its `result`.

        Parameters
        ----------
        error : BaseException
            What ended the run.
        t : float
            Time up to which it came [s].
        **attributes
            As for `finish`; the status is added.

        Raises
        ------
        SimulationInterrupted
            In place of a KeyboardInterrupt; it has a `result`.
        """
        interrupted = isinstance(error, KeyboardInterrupt)
        status = "diverged" if isinstance(error, DivergenceError) else "failed"
        result = self.finish(status="interrupted" if interrupted else status, **attributes)
        if isinstance(error, KeyboardInterrupt):
            raise SimulationInterrupted(
                f"stopped at t = {t:g} s; the result of this exception holds the log", result
            ) from None
        if isinstance(error, TrussflowError):
            error.result = result


def dataset(
    channels: Sequence[Channel], times: Vector, rows: Vector, attributes: Mapping[str, Any]
) -> xr.Dataset:
    """Build the dataset of logged rows."""
    import xarray as xr

    variables = {c.name: (("time", *c.dims), c.values(rows), c.attributes()) for c in channels}
    time = ("time", times, {"units": "s", "long_name": "time"})
    return xr.Dataset(variables, {"time": time}, dict(attributes))


def save(result: xr.Dataset, path: str | Path) -> Path:
    """Write a result to a netCDF file, in one piece.

    Parameters
    ----------
    result : xarray.Dataset
        What `simulate` returned.
    path : str or pathlib.Path
        File to write; an old one is replaced only when the new one is complete.

    Raises
    ------
    SimulationError
        If the file cannot be written.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.partial")
    try:
        result.to_netcdf(partial, engine="netcdf4")
        os.replace(partial, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise SimulationError(f"cannot write the result to '{path}': {error}") from error
    return path


class StreamedLog(Log):
    """Rows written to a netCDF file while a run goes on: memory stays constant."""

    def __init__(self, channels: Sequence[Channel], attributes: Mapping[str, Any], path: str | Path) -> None:
        import netCDF4

        super().__init__(channels, attributes)
        self.path = Path(path)
        self._partial = self.path.with_name(f".{self.path.name}.partial")
        self._waiting = 0
        if self.path.is_dir():
            raise SimulationError(f"cannot write the result to '{path}': it is a folder")
        try:
            self._file = netCDF4.Dataset(str(self._partial), "w")
        except OSError as error:
            raise SimulationError(f"cannot write the result to '{path}': {error}") from error
        self._file.createDimension("time", None)
        self._time = self._file.createVariable("time", "f8", ("time",), chunksizes=(CHUNK_ROWS,))
        self._time.setncatts({"units": "s", "long_name": "time"})
        for channel in channels:
            dims = channel.dims
            for name, size in zip(dims, channel.port.shape or (), strict=True):
                if name not in self._file.dimensions:
                    self._file.createDimension(name, size)
            sizes = CHUNK_ROWS, *(channel.port.shape or ())
            variable = self._file.createVariable(
                channel.name, "f8", ("time", *dims), chunksizes=[max(1, n) for n in sizes]
            )
            variable.setncatts(channel.attributes())

    def append(self, times: Vector, rows: Vector) -> None:
        """Add rows; they reach the file in large chunks."""
        super().append(times, rows)
        self._waiting += rows.size + times.size
        if self._waiting > WAITING_NUMBERS:
            self._flush()

    def _flush(self) -> None:
        """Write what waits in memory to the file."""
        times, rows = self._collected()
        start = len(self._time)
        self._time[start:] = times
        for channel in self.channels:
            self._file[channel.name][start : start + len(times)] = channel.values(rows)
        self._times, self._rows, self._waiting = [], [], 0

    def finish(self, **attributes: Any) -> xr.Dataset:
        """Complete the file and return it, opened lazily."""
        import xarray as xr

        self._flush()
        self._file.setncatts({k: _text(v) for k, v in (self.attributes | attributes).items()})
        self._file.close()
        os.replace(self._partial, self.path)
        return xr.open_dataset(self.path, engine="netcdf4", decode_cf=False)


def opened(channels: Sequence[Channel], attributes: Mapping[str, Any], path: str | Path | None) -> Log:
    """Return a log in a file, or in memory if there is no path."""
    return Log(channels, attributes) if path is None else StreamedLog(channels, attributes, path)


def _text(value: Any) -> Any:
    return value if isinstance(value, str | int | float) else json.dumps(value)
