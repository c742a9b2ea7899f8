"""Figures 3 to 19 of the paper, and those of the theorems."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from reproduction.measures import TORQUE_BOUNDS, observer_signals, of_robot
from trussflow.blocks.support.progress import counted
from trussflow.blocks.support.types import Vector
from trussflow.models.geometry.rotation import euler_rate_matrix
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.transport.figures import components
from trussflow.models.transport.mission import Mission

CONTROLLERS = {"": "proposed", "-smc": "SMC", "-pd": "PD"}

Results = Callable[[str], xr.Dataset]
"""Function that returns the result of a run, with named axes, by its name."""

Panels = Callable[[Results, str], list[Panel]]
"""Function that returns panels of a run and of those with the suffixes that it compares."""


class FigureKind(NamedTuple):
    """Contents of figures of the paper.

    Attributes
    ----------
    panels : callable
        Function that returns the panels.
    suffixes : tuple of str
        Suffixes of the runs in the figure.
    note : str
        Explanation of the panels if the caption does not suffice.
    """

    panels: Panels
    suffixes: tuple[str, ...] = ("",)
    note: str = ""


def _vectors(robot: int | None = None, **ylabels: str) -> Panels:
    """Return panels of the components of vectors, by their names in the result."""

    def panels(results: Results, run: str) -> list[Panel]:
        result = results(run) if robot is None else of_robot(results(run), robot)
        return [
            Panel(curves=components(result[name]), y=y) for name, y in ylabels.items()
        ]

    return panels


def _main_axis(run: str) -> int:
    """Return the axis with the largest commanded displacement of a run."""
    return int(np.abs(Mission.of_case(int(run[4])).position).argmax())


def _control_force(results: Results, run: str) -> list[Panel]:
    force = {
        label: results(name).generalized_force[:, :3]
        for label, name in (
            ("with observer", run),
            ("without observer", f"{run}-no-observer"),
        )
    }
    axis, end = _main_axis(run), Mission.of_case(int(run[4])).duration
    found = [
        Panel(curves=components(f), y="control force [N]", title=label)
        for label, f in force.items()
    ]
    both = [Curve(k, f["time"].values, f.values[:, axis]) for k, f in force.items()]
    y = f"control force, {'xyz'[axis]} [N]"
    spans = ((0.0, 4.0), (end - 1.0, end + 3.0))
    return [*found, *(Panel(curves=both, y=y, span=span) for span in spans)]


def _forces_per_robot(results: Results, run: str) -> list[Panel]:
    force = results(run).base_force
    return [
        Panel(
            curves=components(force.sel(robot=i)),
            y="base force [N]",
            title=f"Robot {i}",
        )
        for i in force["robot"].values
    ]


def _torques(*robots: int) -> Panels:
    def panels(results: Results, run: str) -> list[Panel]:
        bound = TORQUE_BOUNDS[int(run[4])]
        return [
            Panel(
                curves=components(of_robot(results(run), i)[f"{kind}_torque"]),
                y=f"{kind} torque [N·m]",
                levels=(-bound, bound),
                title=f"Robot {i}" if kind == "base" else "",
            )
            for i in robots
            for kind in ("base", "joint")
        ]

    return panels


def _first_joint(results: Results, run: str) -> list[Panel]:
    result = results(run).sel(joint="theta_4_1")
    quantities = {
        "joint angle [rad]": result.joint_angle,
        "joint rate [rad/s]": result.joint_rate,
    }
    time = result["time"].values
    return [
        Panel(curves=[Curve("", time, values.values)], y=y)
        for y, values in quantities.items()
    ]


def _by_controller(
    results: Results, run: str, values: Callable[[xr.Dataset], Vector]
) -> list[Curve]:
    runs = {label: results(f"{run}{suffix}") for suffix, label in CONTROLLERS.items()}
    return [
        Curve(label, result["time"].values, values(result))
        for label, result in runs.items()
    ]


def _sizes(results: Results, run: str, variable: str, y: str) -> Panel:
    curves = _by_controller(
        results, run, lambda r: np.linalg.norm(r[variable].values, axis=1)
    )
    return Panel(curves=curves, y=y, log=True)


def _compared_errors(results: Results, run: str) -> list[Panel]:
    return [
        _sizes(results, run, "position_error", "‖displacement error‖ [m]"),
        _sizes(results, run, "attitude_error", "‖attitude error‖ [rad]"),
    ]


def _turning(result: xr.Dataset) -> Vector:
    """Return the angular velocity A dΘ/dt of the truss about its own z axis, shape (time,) [rad/s]."""
    rates = zip(result.attitude.values, result.attitude_rate.values, strict=True)
    return np.array([euler_rate_matrix(angles)[2] @ rate for angles, rate in rates])


def _compared_velocities(results: Results, run: str) -> list[Panel]:
    mission, axis = Mission.of_case(int(run[4])), _main_axis(run)
    name, half = "xyz"[axis], mission.duration / 2
    velocity = _by_controller(results, run, lambda r: r.velocity.values[:, axis])
    found = [
        Panel(curves=velocity, y=f"velocity, {name} [m/s]"),
        _sizes(results, run, "position_error_rate", "‖velocity error‖ [m/s]"),
    ]
    if mission.attitude.any():
        found += [
            Panel(
                curves=_by_controller(results, run, _turning),
                y="angular velocity, z [rad/s]",
            ),
            _sizes(
                results, run, "attitude_error_rate", "‖attitude rate error‖ [rad/s]"
            ),
        ]
    zoomed = _by_controller(
        results, run, lambda r: r.position_error_rate.values[:, axis]
    )
    rotation = _by_controller(
        results, run, lambda r: r.attitude_error_rate.values[:, 2]
    )
    span = (half, half + 2.0)
    return [
        *found,
        Panel(curves=zoomed[:2], y=f"velocity error, {name} [m/s]", span=span),
        Panel(curves=rotation[:2], y="error of dψ/dt [rad/s]", span=span),
    ]


TORQUE_NOTE = "Base torques in base axes and joint torques; dashed, the bound that the paper gives."
COMPARED = tuple(CONTROLLERS)

POSITION = FigureKind(_vectors(position="displacement [m]"))
MOTION = FigureKind(_vectors(position="displacement [m]", attitude="attitude [rad]"))
ERROR = FigureKind(_vectors(position_error="displacement error [m]"))
TURN_ERROR = FigureKind(_vectors(attitude_error="attitude error [rad]"))
FORCE = FigureKind(
    _control_force,
    ("", "-no-observer"),
    "Force part of u in truss axes; below, the largest component at the start and at the end of the motion.",
)
FORCES = FigureKind(
    _forces_per_robot,
    note="Forces on the bases, in base axes; their z axis points along -z of the truss.",
)
TORQUES_OF_4 = FigureKind(_torques(4), note=TORQUE_NOTE)
TORQUES = FigureKind(_torques(1, 2, 3, 4), note=TORQUE_NOTE)
ELASTIC = FigureKind(_vectors(4, grasp_displacement="elastic displacement [m]"))
JOINT = FigureKind(_first_joint)
ERRORS = FigureKind(_compared_errors, COMPARED)
VELOCITIES = FigureKind(
    _compared_velocities,
    COMPARED,
    "Last row: proposed law and SMC in the middle of the motion. SMC switches within the steps of "
    "the solver, which leaves its velocity at their ends with an offset that is not in its "
    "position.",
)

FIRST_FIGURE = 3
"""Number in the paper of the first of the `PAPER_FIGURES` [-]."""

PAPER_FIGURES = (
    ("Displacement of the truss", 1, POSITION),
    ("Tracking errors of the displacement", 1, ERROR),
    ("Control force of the system", 1, FORCE),
    ("Control forces of the robots", 1, FORCES),
    ("Control torques of Robot 4", 1, TORQUES_OF_4),
    ("Flexible displacement at C₄,₀ of Robot 4", 1, ELASTIC),
    ("Joint angle and angular velocity of C₄,₁", 1, JOINT),
    ("Motion of the truss", 2, MOTION),
    ("Tracking errors of the displacement in Case 2", 2, ERROR),
    ("Tracking errors of the attitude", 2, TURN_ERROR),
    ("Control force of the system in Case 2", 2, FORCE),
    ("Control torques of the robots", 2, TORQUES),
    ("Flexible displacement at C₄,₀ of Robot 4 in Case 2", 2, ELASTIC),
    ("Tracking errors under different controllers in Case 1", 1, ERRORS),
    ("Velocity of the truss under different controllers in Case 1", 1, VELOCITIES),
    ("Tracking errors under different controllers in Case 2", 2, ERRORS),
    (
        "Velocity and angular velocity of the truss under different controllers in Case 2",
        2,
        VELOCITIES,
    ),
)
"""Caption in the paper, case and contents of each figure."""


def draw_paper_figures(results: Results, folder: Path) -> str:
    """Draw the figures of the paper and return their part of the report.

    Parameters
    ----------
    results : callable
        Function that returns the result of a run.
    folder : pathlib.Path
        Folder of the report.
    """
    parts = []
    numbered = list(enumerate(PAPER_FIGURES, FIRST_FIGURE))
    for number, (caption, case, kind) in counted("drawing figures", numbered):
        run, file = f"case{case}", f"figure-{number:02d}.png"
        save(drawing(kind.panels(results, run)), folder / file, small=True)
        names = ", ".join(f"`{run}{suffix}`" for suffix in kind.suffixes)
        words = f"**Figure {number}.** {caption}.", kind.note, f"Runs: {names}."
        text = " ".join(filter(None, words))
        parts.append(f"![Figure {number}]({file})\n\n{text}")
    return "\n\n".join(parts)


def draw_theorems(
    results: Results, bounds: dict[str, tuple[float, float]], file: Path
) -> None:
    """Draw estimation error and V of runs with the bounds of the theorems.

    Parameters
    ----------
    results : callable
        Function that returns the result of a run.
    bounds : dict
        Bounds of the estimation error and of V, keyed by the run.
    file : pathlib.Path
        Figure to write.
    """
    panels = []
    for run, levels in bounds.items():
        time, error, lyapunov, _ = observer_signals(results(run))
        later = time > 1.0  # s; without the initial jump of the pushed runs
        quantities = {"estimation error": ("‖d̂ − d‖", error), "V": ("V", lyapunov)}
        for (y, (label, values)), level in zip(quantities.items(), levels, strict=True):
            panels.append(
                Panel(
                    curves=[Curve(label, time[later], values[later])],
                    levels=(level,) if np.isfinite(level) else (),
                    y=y,
                    log=True,
                    title=run if y != "V" else "",
                )
            )
    save(drawing(panels), file, small=True)
