"""Results: what was logged, as an `xarray.Dataset` with units, frames and provenance."""

from __future__ import annotations

import contextlib
import datetime
import platform
import shutil
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.files import replaced
from trussflow.blocks.framework.interrupts import uninterrupted
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import as_path
from trussflow.blocks.simulation.channels import Channel

if TYPE_CHECKING:
    import xarray as xr


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


def dataset(
    channels: Sequence[Channel], times: Vector, rows: Vector, attributes: Mapping[str, Any]
) -> xr.Dataset:
    """Build the dataset of `rows` [as declared] logged at `times` [s] in `channels`, with `attributes`."""
    import xarray as xr

    variables = {c.name: (("time", *c.dims), c.values(rows), c.attributes()) for c in channels}
    time = ("time", times, {"units": "s", "long_name": "time"})
    return xr.Dataset(variables, {"time": time}, dict(attributes))


WRITE_ERRORS = OSError, RuntimeError, UnicodeError
"""What the netCDF library raises: a full disk is a RuntimeError "HDF error", without a number."""


def cannot_write(path: str | Path, error: BaseException, more: str = "") -> SimulationError:
    """Return what to raise if a result cannot be written to `path`, because of an `error`; say `more`."""
    reason = str(error)
    with contextlib.suppress(OSError):
        free = shutil.disk_usage(Path(path).parent).free
        reason += f" (is the disk full? {free / 1e6:.1f} MB are free)" * isinstance(error, RuntimeError)
    return SimulationError("; ".join(filter(None, [f"cannot write the result to '{path}': {reason}", more])))


def refuse_other_kinds(path: str | Path, doing: str = "write the result to") -> None:
    """Refuse a `path` whose name says that it is no netCDF file, or that is none, when `doing` that.

    Raises
    ------
    SimulationError
        If so.
    """
    suffix = as_path(SimulationError, f"cannot {doing}", path).suffix.lower()
    if suffix in {".csv", ".txt", ".json", ".mat", ".npy", ".npz", ".parquet", ".pkl", ".xlsx", ".zarr"}:
        raise SimulationError(
            f"cannot {doing} '{path}': results are netCDF files, named .nc; for another kind, "
            "use methods of xarray and pandas, such as result.to_dataframe().to_csv(...)"
        )


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
        If the file cannot be written, or its name says that it is of another kind.
    """
    refuse_other_kinds(path)
    if not hasattr(result, "to_netcdf"):
        raise SimulationError(f"cannot write {type(result).__name__} to '{path}': it is no result of a run")
    try:
        with uninterrupted(), replaced(path) as partial:  # xarray takes locks
            result.to_netcdf(partial, engine="netcdf4")
    except WRITE_ERRORS as error:
        raise cannot_write(path, error) from error
    return Path(path)
