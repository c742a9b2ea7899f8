"""Results: what was logged, as an `xarray.Dataset` with units, frames and provenance."""

from __future__ import annotations

import datetime
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.files import replaced
from trussflow.blocks.framework.types import Vector
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
    try:
        with replaced(path) as partial:
            result.to_netcdf(partial, engine="netcdf4")
    except OSError as error:
        raise SimulationError(f"cannot write the result to '{path}': {error}") from error
    return Path(path)
