"""Figures of merit of a mission."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trussflow.models.reporting.metrics import (
    largest_component,
    largest_norm,
    tracking_metrics,
)
from trussflow.models.reporting.quantities import prefixed
from trussflow.models.reporting.tables import text_table
from trussflow.models.transport.mission import Mission

if TYPE_CHECKING:
    import xarray as xr


class FigureOfMerit(NamedTuple):
    """Figure of merit of a mission.

    Attributes
    ----------
    name : str
        Name of the quantity.
    value : float
        Value of the quantity [unit].
    unit : str
        Unit of the value.
    """

    name: str
    value: float
    unit: str


def summarize(result: xr.Dataset, mission: Mission) -> list[FigureOfMerit]:
    """Return the figures of merit of a mission.

    Parameters
    ----------
    result : xarray.Dataset
        Result with the signals of `logged`.
    mission : Mission
        Simulated mission.
    """
    errors = {
        f"{name} error": result[f"{name}_error"].values
        for name in ("position", "attitude")
    }
    time = result["time"].values
    found = tracking_metrics(time, errors)
    largest = [
        (f"{part} {name}", found[f"{part} {name} (component)"], unit)
        for name, unit in (("position error", "m"), ("attitude error", "rad"))
        for part in ("peak", "final")
    ]
    forces = np.abs(result["base_force"].values).max(axis=(0, 2))
    largest += [
        (f"peak base force, Robot {i}", float(force), "N")
        for i, force in enumerate(forces, 1)
    ]
    largest.append(
        ("peak base torque", largest_component(result["base_torque"]), "N*m")
    )
    if "joint_error" in result:
        peak, torque = (
            largest_component(result[name]) for name in ("joint_error", "joint_torque")
        )
        largest.append(
            ("peak joint error", peak, result["joint_error"].attrs.get("units", "rad"))
        )
        largest.append(("peak joint torque", torque, "N*m"))
    bent = largest_component(result["grasp_displacement"].values[:, -1])
    largest.append(("peak elastic displacement, last grasp", bent, "m"))
    figures = [FigureOfMerit(*each) for each in largest]
    if result.attrs.get("observer", 0):
        # The initial error decays as exp(-L t); of a very short run the second half is evaluated.
        late = time >= min(5 / mission.observer_bandwidth, time[-1] / 2)
        error = largest_norm(
            (result["disturbance_estimate"] - result["disturbance"]).values[late]
        )
        figures.append(
            FigureOfMerit("peak disturbance estimation error (norm)", error, "m/s^2")
        )
    return figures


TITLES = ("figure (largest component)", "value", "unit")


def cells(figures: list[FigureOfMerit]) -> list[tuple[str, ...]]:
    """Return the figures as rows of a table under `TITLES`."""
    return [(f.name, *prefixed(f.value, f.unit)) for f in figures]


def table(figures: list[FigureOfMerit]) -> str:
    """Return the figures as a text table."""
    return text_table(TITLES, cells(figures))
