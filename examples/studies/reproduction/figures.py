"""Figures 3 to 19 of the source."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from reproduction.measures import TORQUE_BOUNDS, norm, of_robot
from reproduction.results import Results
from trussflow.models.geometry.rotation import euler_rate_matrix
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.transport.figures import components

CONTROLLERS = {"": "proposed", "-smc": "SMC", "-pd": "PD"}

Panels = Callable[[Results, str], list[Panel]]
"""Of a run; what it is compared with is found by its name."""


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """One figure of the source.

    Attributes
    ----------
    number : int
        As in the source.
    caption : str
        As in the source.
    runs : tuple of str
        The runs it shows, the one that the others are compared with first.
    panels : callable
        Returns its panels, given the first run.
    note : str
        What the panels are, where the caption leaves it open.
    """

    number: int
    caption: str
    runs: tuple[str, ...]
    panels: Panels
    note: str = ""

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"figure-{self.number:02d}.png"

    def draw(self, results: Results, folder: Path) -> None:
        """Draw it from `results` into `folder`."""
        save(drawing(self.panels(results, self.runs[0])), folder / self.file, small=True)


def _vectors(robot: int | None = None, **ylabels: str) -> Panels:
    """Return panels of the components of vectors, by their names in the result."""

    def panels(results: Results, run: str) -> list[Panel]:
        result = results[run] if robot is None else of_robot(results[run], robot)
        return [Panel(curves=components(result[name]), y=y) for name, y in ylabels.items()]

    return panels


def _control_force(results: Results, run: str) -> list[Panel]:
    mission = results.mission(run)
    force = {
        label: results[name].generalized_force[:, :3]
        for label, name in (("with observer", run), ("without observer", f"{run}-no-observer"))
    }
    axis = int(np.abs(mission.position).argmax())
    found = [Panel(curves=components(f), y="control force [N]", title=label) for label, f in force.items()]
    both = [Curve(k, f["time"].values, f.values[:, axis]) for k, f in force.items()]
    y = f"control force, {'xyz'[axis]} [N]"
    spans = ((0.0, 4.0), (mission.duration - 1.0, mission.duration + 3.0))
    return [*found, *(Panel(curves=both, y=y, span=span) for span in spans)]


def _forces_per_robot(results: Results, run: str) -> list[Panel]:
    force = results[run].base_force
    return [
        Panel(curves=components(force.sel(robot=i)), y="base force [N]", title=f"Robot {i}")
        for i in force["robot"].values
    ]


def _torques(*robots: int) -> Panels:
    def panels(results: Results, run: str) -> list[Panel]:
        bound = TORQUE_BOUNDS[results.run(run).case]
        return [
            Panel(
                curves=components(of_robot(results[run], i)[f"{kind}_torque"]),
                y=f"{kind} torque [N·m]",
                levels=(-bound, bound),
                title=f"Robot {i}" if kind == "base" else "",
            )
            for i in robots
            for kind in ("base", "joint")
        ]

    return panels


def _first_joint(results: Results, run: str) -> list[Panel]:
    result = results[run].sel(joint="theta_4_1")
    time = result["time"].values
    return [
        Panel(curves=[Curve("", time, result.joint_angle.values)], y="joint angle [rad]"),
        Panel(curves=[Curve("", time, result.joint_rate.values)], y="joint rate [rad/s]"),
    ]


def _by_controller(results: Results, run: str, values: Callable[[xr.Dataset], np.ndarray]) -> list[Curve]:
    runs = {label: results[f"{run}{suffix}"] for suffix, label in CONTROLLERS.items()}
    return [Curve(label, result["time"].values, values(result)) for label, result in runs.items()]


def _sizes(results: Results, run: str, variable: str, y: str) -> Panel:
    return Panel(curves=_by_controller(results, run, lambda r: norm(r[variable])), y=y, log=True)


def _compared_errors(results: Results, run: str) -> list[Panel]:
    return [
        _sizes(results, run, "position_error", "‖displacement error‖ [m]"),
        _sizes(results, run, "attitude_error", "‖attitude error‖ [rad]"),
    ]


def angular_velocity(result: xr.Dataset) -> np.ndarray:
    """Return the angular velocity of the truss in its own axes, A dΘ/dt, shape (time, 3) [rad/s].

    Parameters
    ----------
    result : xarray.Dataset
        Result of a run.
    """
    rates = zip(result.attitude.values, result.attitude_rate.values, strict=True)
    return np.array([euler_rate_matrix(angles) @ rate for angles, rate in rates])


def _compared_velocities(results: Results, run: str) -> list[Panel]:
    mission = results.mission(run)
    axis = int(np.abs(mission.position).argmax())
    name, half = "xyz"[axis], mission.duration / 2
    velocity = _by_controller(results, run, lambda r: r.velocity.values[:, axis])
    found = [
        Panel(curves=velocity, y=f"velocity, {name} [m/s]"),
        _sizes(results, run, "position_error_rate", "‖velocity error‖ [m/s]"),
    ]
    if mission.attitude.any():
        turning = _by_controller(results, run, lambda r: angular_velocity(r)[:, 2])
        found += [
            Panel(curves=turning, y="angular velocity, z [rad/s]"),
            _sizes(results, run, "attitude_error_rate", "‖attitude rate error‖ [rad/s]"),
        ]
    zoomed = _by_controller(results, run, lambda r: r.position_error_rate.values[:, axis])
    rotation = _by_controller(results, run, lambda r: r.attitude_error_rate.values[:, 2])
    span = (half, half + 2.0)
    return [
        *found,
        Panel(curves=zoomed[:2], y=f"velocity error, {name} [m/s]", span=span),
        Panel(curves=rotation[:2], y="error of dψ/dt [rad/s]", span=span),
    ]


DISPLACEMENT, ERROR = "displacement [m]", "displacement error [m]"
ELASTIC = "elastic displacement [m]"
CASE_1, CASE_2 = ("case1",), ("case2",)
BOTH_1 = ("case1", "case1-no-observer")
BOTH_2 = ("case2", "case2-no-observer")
COMPARED_1 = tuple(f"case1{suffix}" for suffix in CONTROLLERS)
COMPARED_2 = tuple(f"case2{suffix}" for suffix in CONTROLLERS)
OBSERVER_NOTE = (
    "Force part of u in truss axes; below, the largest component at the start and at the end of the motion."
)
TORQUE_NOTE = "Base torques in base axes and joint torques; dashed, the bound that the source gives"
COMPARED_NOTE = (
    "Last row: proposed law and SMC in the middle of the motion. SMC switches within the steps of "
    "the solver, which leaves its velocity at their ends with an offset that is not in its "
    "position."
)

PAPER_FIGURES = (
    PaperFigure(3, "Displacement of the truss", CASE_1, _vectors(position=DISPLACEMENT)),
    PaperFigure(4, "Tracking errors of the displacement", CASE_1, _vectors(position_error=ERROR)),
    PaperFigure(5, "Control force of the system", BOTH_1, _control_force, OBSERVER_NOTE),
    PaperFigure(
        6,
        "Control forces of the robots",
        CASE_1,
        _forces_per_robot,
        "Forces on the bases, in base axes; their z axis points along -z of the truss.",
    ),
    PaperFigure(7, "Control torques of Robot 4", CASE_1, _torques(4), f"{TORQUE_NOTE}."),
    PaperFigure(
        8, "Flexible displacement at C₄,₀ of Robot 4", CASE_1, _vectors(4, grasp_displacement=ELASTIC)
    ),
    PaperFigure(9, "Joint angle and angular velocity of C₄,₁", CASE_1, _first_joint),
    PaperFigure(
        10, "Motion of the truss", CASE_2, _vectors(position=DISPLACEMENT, attitude="attitude [rad]")
    ),
    PaperFigure(11, "Tracking errors of the displacement in Case 2", CASE_2, _vectors(position_error=ERROR)),
    PaperFigure(
        12, "Tracking errors of the attitude", CASE_2, _vectors(attitude_error="attitude error [rad]")
    ),
    PaperFigure(13, "Control force of the system in Case 2", BOTH_2, _control_force, OBSERVER_NOTE),
    PaperFigure(14, "Control torques of the robots", CASE_2, _torques(1, 2, 3, 4), f"{TORQUE_NOTE}."),
    PaperFigure(
        15,
        "Flexible displacement at C₄,₀ of Robot 4 in Case 2",
        CASE_2,
        _vectors(4, grasp_displacement=ELASTIC),
    ),
    PaperFigure(16, "Tracking errors under different controllers in Case 1", COMPARED_1, _compared_errors),
    PaperFigure(
        17,
        "Velocity of the truss under different controllers in Case 1",
        COMPARED_1,
        _compared_velocities,
        COMPARED_NOTE,
    ),
    PaperFigure(18, "Tracking errors under different controllers in Case 2", COMPARED_2, _compared_errors),
    PaperFigure(
        19,
        "Velocity and angular velocity of the truss under different controllers in Case 2",
        COMPARED_2,
        _compared_velocities,
        COMPARED_NOTE,
    ),
)
"""In the order of the source."""
