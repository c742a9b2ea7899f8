"""Time histories for the page of a run: motion, forces, and all logged signals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.units import distinct
from trussflow.blocks.results.conversions import elements_of, labels_of
from trussflow.blocks.support.files import reading
from trussflow.blocks.support.packing import packed, spread
from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.plant.space_truss import SpaceTruss

if TYPE_CHECKING:
    import xarray as xr

MAX_NUMBERS = 2_500_000
"""Numbers per page if they compress well; longer runs are shown at fewer instants [-]."""
COORDINATE_BITS = 37
"""Mantissa bits of a coordinate in the picture, about ten decimal digits [-]."""
SHOWN_DISPLACEMENT = 0.5
"""Largest elastic displacement in the picture by the default exaggeration [m]."""
CHART_BITS = 14
"""Mantissa bits of a number in a chart, about four decimal digits [-]."""


def opened(result: xr.Dataset | str | Path) -> xr.Dataset:
    """Return a result, or read it from its file.

    Parameters
    ----------
    result : xarray.Dataset, str or pathlib.Path
        Result of a run, or its netCDF file.

    Raises
    ------
    ModelError
        If the argument is neither.
    """
    import xarray as xr

    if isinstance(result, xr.Dataset):
        return result
    if not isinstance(result, str | Path):
        raise ModelError(
            f"cannot show {type(result).__name__}: give the result of a run, or its file"
        )
    damaged = (
        "it is not a complete netCDF file of a run ({}); the rows of a killed run are read by "
        "trussflow.blocks.recover"
    )
    with reading(result, ModelError, "cannot show", damaged) as path:
        return xr.load_dataset(path, engine="netcdf4", decode_cf=False)


class Motion:
    """Time histories for the viewer, from a result and its plant.

    Parameters
    ----------
    result : xarray.Dataset
        Result of a run.
    truss : SpaceTruss
        Plant of the run.

    Attributes
    ----------
    time : Vector, shape (instants,)
        Logged instants [s].
    coordinates : Vector, shape (nq, instants)
        Coordinates q of `SpaceTruss` [m, unit of the attitude, rad, kg^½·m].
    signals : dict of str to xarray.DataArray
        Logged signals.
    truss : SpaceTruss
        Plant of the run.

    Raises
    ------
    ModelError
        If required signals are missing in the result, belong to another truss, or are not finite.
    """

    def __init__(self, result: xr.Dataset, truss: SpaceTruss) -> None:
        self.truss = truss
        self.signals = {
            str(name): variable
            for name, variable in result.data_vars.items()
            if variable.dims[:1] == ("time",)
            and variable.dtype.kind in "fiub"
            and variable.size
        }
        timed = "time" in result.coords and result["time"].dtype.kind in "fiu"
        self.time = np.asarray(result["time"], dtype=float) if timed else np.zeros(0)
        steps = np.diff(self.time)
        if not (len(steps) and (steps >= 0.0).all() and np.isfinite(steps).all()):
            raise ModelError(
                "cannot show the result: its coordinate 'time' must have two or more ascending instants in "
                f"seconds; it has {len(self.time)} instants"
            )
        modes, angles = truss.modes, truss.dynamics.attitude.end - 3
        joints = {"joint_angle": truss.joints, "modal_coordinate": modes}
        for sizes in (
            {"coordinates": truss.nq},
            {"task_position": truss.rigid_q, "modal_coordinate": modes},
            {"position": 3, "attitude": angles, **joints},
        ):
            ports = [port for port, size in sizes.items() if size]
            if all(map(self.name_of, ports)):
                break
        else:
            there = ", ".join(self.signals) or "nothing"
            raise ModelError(
                "cannot show the result: it has no motion of the truss; log its outputs coordinates, or "
                "task_position and modal_coordinate, and for arrows base_force and base_torque; it has "
                f"{there}"
            )
        self.coordinates = np.concatenate(
            [self._values(port, sizes[port]) for port in ports]
        )

    def name_of(self, port: str) -> str | None:
        """Return the name of the logged signal of a port of the truss, or None; its block has any name."""
        names = [name for name in self.signals if name.rpartition(".")[2] == port]
        # other blocks, such as sensors, have ports of the same name
        return max(names, key=lambda name: f".truss.{port}" in f".{name}", default=None)

    def _values(self, port: str, size: int) -> Vector:
        variable = self.signals[self.name_of(port) or ""]
        values = elements_of(variable)
        if len(values) != size:
            truss = self.truss
            raise ModelError(
                f"cannot show the result: '{variable.name}' has {len(values)} elements instead of "
                f"{size}; this truss has {truss.robots} robots, {truss.joints} joints and "
                f"{truss.modes} modes: give the truss of the run"
            )
        bad = ~np.isfinite(values).all(axis=0)
        if bad.any():
            raise ModelError(
                f"cannot show the result: '{variable.name}' is not finite at "
                f"t = {self.time[bad.argmax()]:g} s; remove the rest with result.sel(time=slice(0, ...))"
            )
        return values

    def exaggeration(self) -> int:
        """Return the scale of the largest grasp displacement to `SHOWN_DISPLACEMENT`, 1 to 500 [-]."""
        modes = self.coordinates[self.truss.rigid_q :]
        moved = np.tensordot(self.truss.dynamics.modes.grasp_translations, modes, 1)
        peak = np.abs(moved).max(initial=SHOWN_DISPLACEMENT / 500.0)
        return max(1, int(SHOWN_DISPLACEMENT / peak))

    def data(self, share: float) -> dict[str, Any]:
        """Return the data of the page, with a `share` of the numbers per page [-]."""
        size = 3 * self.truss.robots
        numbers = sum(variable[0].size for variable in self.signals.values())
        room = share * MAX_NUMBERS / (numbers + len(self.coordinates) + 2 * size)
        shown = spread(len(self.time), room)
        pushes = {
            name: self._values(port, size).reshape(-1, 3, len(self.time))
            for name, port in (("force", "base_force"), ("torque", "base_torque"))
            if self.name_of(port)
        }
        return {
            "logged": len(self.time),
            "shown": len(shown),
            "time": packed(self.time[shown]),
            "coordinates": packed(self.coordinates[:, shown], COORDINATE_BITS),
            "ends": [self.truss.dynamics.attitude.end, self.truss.rigid_q],
            "longest": {k: np.linalg.norm(v, axis=1).max() for k, v in pushes.items()},
            **{k: packed(v[..., shown].reshape(size, -1)) for k, v in pushes.items()},
            "signals": [
                {
                    "name": name,
                    "units": distinct(str(variable.attrs.get("units") or "")),
                    "components": [" ".join(labels) for labels in labels_of(variable)],
                    "inner": variable.shape[2] if variable.ndim > 2 else 1,
                    "values": packed(elements_of(variable)[:, shown], CHART_BITS),
                }
                for name, variable in self.signals.items()
            ],
        }
