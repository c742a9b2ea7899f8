"""Logs: rows of numbers collected while a run goes on, in memory or in a file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.errors import (
    DivergenceError,
    SimulationError,
    SimulationInterrupted,
    TrussflowError,
)
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.channels import Channel
from trussflow.blocks.simulation.results import dataset

if TYPE_CHECKING:
    import xarray as xr


CHUNK_ROWS = 1024
"""Rows that a file keeps together; netCDF's own choice, one row, is slow."""

WAITING_NUMBERS = 500_000
"""Numbers that wait in memory before a streamed log writes them; 4 MB."""


Messages = Mapping[str, Sequence[str]]
"""What there is to tell of a run, by block or member."""


class Log:
    """Rows collected in memory.

    Parameters
    ----------
    channels : sequence of Channel
        What a row consists of.
    attributes : mapping
        What the result says of the run.

    Attributes
    ----------
    width : int
        Numbers in a row [-].
    last : float
        Time of the last row [s].
    """

    def __init__(self, channels: Sequence[Channel], attributes: Mapping[str, Any]) -> None:
        self.channels = channels
        self.attributes = dict(attributes)
        self.width = channels[-1].columns.stop if channels else 0
        self._times: list[Vector] = []
        self._rows: list[Vector] = []
        self._buffer = np.empty(0), np.empty((0, self.width))
        self._used = 0
        self.last = 0.0
        self._usual = max(1, min(CHUNK_ROWS, WAITING_NUMBERS // (1 + self.width)))

    def reserve(self, number: int) -> Vector:
        """Return room for a `number` of rows [-], to be filled and then kept by `keep`."""
        if self._used + number > len(self._buffer[0]):
            self._put_aside()
            size = max(number, self._usual)
            self._buffer = np.empty(size), np.empty((size, self.width))
        return self._buffer[1][self._used : self._used + number]

    def keep(self, times: Vector | float, number: int = 1) -> None:
        """Keep the first rows of those reserved last.

        Parameters
        ----------
        times : Vector or float
            Their times [s].
        number : int
            How many there are [-].
        """
        stop = self._used + number
        self._buffer[0][self._used : stop] = times
        if number:
            self.last = float(self._buffer[0][stop - 1])
        self._used = stop

    def _put_aside(self) -> None:
        """Let go of the buffer, so that it is not written any more."""
        times, rows = self._buffer
        if self._used:
            self._times.append(times[: self._used])
            self._rows.append(rows[: self._used])
        self._buffer, self._used = (times[:0], rows[:0]), 0

    def _collected(self) -> tuple[Vector, Vector]:
        """Return all times and rows that are in memory."""
        self._put_aside()
        times = np.concatenate([np.zeros(0), *self._times])
        return times, np.concatenate([np.zeros((0, self.width)), *self._rows])

    def finish(self, messages: Messages, **attributes: Any) -> xr.Dataset:
        """Return everything logged as a dataset, with the `messages` of the run."""
        self.attributes |= attributes
        if messages:
            self.attributes["messages"] = json.dumps(messages)
        return self._dataset()

    def _dataset(self) -> xr.Dataset:
        return dataset(self.channels, *self._collected(), self.attributes)

    def abandon(self, error: BaseException, t: float, messages: Messages, **attributes: Any) -> None:
        """Finish after an error; ours gets what was logged as its `result`.

        Parameters
        ----------
        error : BaseException
            What ended the run.
        t : float
            Time up to which it came [s].
        messages : mapping of str to sequence of str
            What there is to tell of the run, by block or member.
        **attributes
            As for `finish`; the status is added.

        Raises
        ------
        SimulationInterrupted
            In place of a KeyboardInterrupt; it has a `result`.
        """
        interrupted = isinstance(error, KeyboardInterrupt)
        status = "diverged" if isinstance(error, DivergenceError) else "failed"
        result = self.finish(messages, status="interrupted" if interrupted else status, **attributes)
        if isinstance(error, KeyboardInterrupt):
            raise SimulationInterrupted(
                f"stopped at t = {t:g} s; the result of this exception holds the log", result
            ) from None
        if isinstance(error, TrussflowError):
            error.result = result


class StreamedLog(Log):
    """Rows written to a netCDF file at `path` while a run goes on: memory stays constant."""

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

    def _put_aside(self) -> None:
        """Let go of the buffer; rows reach the file in large chunks."""
        self._waiting += self._used * (1 + self.width)
        super()._put_aside()
        if self._waiting > WAITING_NUMBERS:
            self._flush()

    def _flush(self) -> None:
        """Write what waits in memory to the file."""
        if not self._times:
            return
        times, rows = np.concatenate(self._times), np.concatenate(self._rows)
        start = len(self._time)
        self._time[start:] = times
        for channel in self.channels:
            self._file[channel.name][start : start + len(times)] = channel.values(rows)
        self._times, self._rows, self._waiting = [], [], 0

    def _dataset(self) -> xr.Dataset:
        """Complete the file and return it, opened lazily."""
        import xarray as xr

        self._put_aside()
        self._flush()
        self._file.setncatts({k: _text(v) for k, v in self.attributes.items()})
        self._file.close()
        os.replace(self._partial, self.path)
        return xr.open_dataset(self.path, engine="netcdf4", decode_cf=False)


def opened(channels: Sequence[Channel], attributes: Mapping[str, Any], path: str | Path | None) -> Log:
    """Return a log of `channels` with `attributes` in a file, or in memory if there is no `path`."""
    return Log(channels, attributes) if path is None else StreamedLog(channels, attributes, path)


def _text(value: Any) -> Any:
    return value if isinstance(value, str | int | float) else json.dumps(value)
