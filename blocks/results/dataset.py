"""Results: logged signals as an `xarray.Dataset` with units, frames and provenance."""

from __future__ import annotations

import contextlib
import datetime
import functools
import platform
import shutil
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.results.channels import Channel
from trussflow.blocks.results.conversions import signals_of
from trussflow.blocks.support.files import reading, replaced
from trussflow.blocks.support.interrupts import uninterrupted
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import as_path

if TYPE_CHECKING:
    import xarray as xr


@functools.cache
def own_version() -> str:
    """Return the version of this package; looking it up takes as long as a short run."""
    try:
        return version("trussflow")
    except PackageNotFoundError:
        return "unknown"


def provenance() -> dict[str, str]:
    """Return versions and date, for the attributes of a result."""
    return {
        "trussflow_version": own_version(),
        "python_version": platform.python_version(),
        "casadi_version": ca.CasadiMeta.version(),
        "numpy_version": np.__version__,
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def dataset(
    channels: Sequence[Channel],
    times: Vector,
    rows: Sequence[Vector],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Build the dataset of pieces of `rows` [as declared] logged at `times` [s] in `channels`.

    Its attributes are `attributes`.
    """
    # Ctrl-C in the middle of an import would leave a module half imported.
    with uninterrupted():
        import pandas as pd
        import xarray as xr

        import trussflow.blocks.results.accessor  # noqa: F401

    # With fastpath, xarray does not import pint, dask and others to find out whether the array is
    # one of theirs.
    variables = {
        c.name: xr.Variable(
            ("time", *c.axes), c.values(*rows), c.attributes(), fastpath=True
        )
        for c in channels
    }
    time = ("time", pd.Index(times), {"units": "s", "long_name": "time"})
    axes = {
        axis: pd.Index(labels)
        for c in channels
        for axis, labels in c.axes.items()
        if labels
    }
    return xr.Dataset(variables, {"time": time, **axes}, dict(attributes))


WRITE_ERRORS = OSError, RuntimeError, UnicodeError
"""Exceptions of the netCDF library; a full disk raises a RuntimeError "HDF error" without a number."""


def cannot_write(
    path: str | Path, error: BaseException, more: str = ""
) -> SimulationError:
    """Return the error for a result that cannot be written to `path` because of an `error`; `more` follows."""
    reason = str(error)
    with contextlib.suppress(OSError):
        free = shutil.disk_usage(Path(path).parent).free
        # A full disk is a RuntimeError without a reason.
        reason += f" (is the disk full? {free / 1e6:.1f} MB are free)" * isinstance(
            error, RuntimeError
        )
    return SimulationError(
        "; ".join(
            filter(None, [f"cannot write the result to '{path}': {reason}", more])
        )
    )


def refuse_other_kinds(path: str | Path, doing: str = "write the result to") -> None:
    """Check that a `path` is that of a netCDF file; messages name the action, `doing`.

    Raises
    ------
    SimulationError
        If it is not.
    """
    found = as_path(SimulationError, f"cannot {doing}", path)
    suffix = found.suffix.lower()
    # On Linux, a backslash is a part of a name, but not for the netCDF library.
    if "\\" in found.as_posix():
        raise SimulationError(
            f"cannot {doing} '{path}': netCDF takes a backslash as the separator of folders; write /"
        )
    if suffix != ".nc":
        raise SimulationError(
            f"cannot {doing} '{path}': results are netCDF files, named .nc, which MATLAB reads, too; "
            "pandas writes other kinds, as in to_pandas(result).to_csv(...)"
        )


def save(result: xr.Dataset, path: str | Path) -> Path:
    """Write a result to a netCDF file, which keeps units and provenance; MATLAB reads it with ``ncread``.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `simulate`.
    path : str or pathlib.Path
        File to write. An existing file is replaced when the new one is complete.

    Raises
    ------
    SimulationError
        If the file cannot be written or is not named .nc, or `result` is not the result of a run.
    """
    refuse_other_kinds(path)
    signals_of(result, f"write to '{path}'")
    # With pandas 3, older versions of xarray cannot write labels of type object.
    texts = {
        name: c.astype(str) for name, c in result.coords.items() if c.dtype == object
    }
    try:
        # Ctrl-C while xarray has a lock could leave it locked.
        with uninterrupted(), replaced(path) as partial, _without_cluster():
            result.assign_coords(texts).to_netcdf(partial, engine="netcdf4")
    except WRITE_ERRORS as error:
        raise cannot_write(path, error) from error
    return Path(path)


def _without_cluster() -> contextlib.AbstractContextManager[Any]:
    """Return a context without the lock of a Dask cluster, which a lost scheduler never grants."""
    dask = sys.modules.get("dask")  # without it there is no cluster
    return (
        contextlib.nullcontext()
        if dask is None
        else dask.config.set(scheduler="synchronous")
    )


def load(path: str | Path) -> xr.Dataset:
    """Read a result from a netCDF file, which `save` has written, or to which a run was streamed.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Raises
    ------
    SimulationError
        If it cannot be read.
    """
    import xarray as xr

    import trussflow.blocks.results.accessor  # noqa: F401

    refuse_other_kinds(path, "read a result from")
    with reading(path, SimulationError, "cannot read a result from") as file:
        # Times are seconds of a run, not dates.
        return xr.load_dataset(file, engine="netcdf4", decode_times=False)
