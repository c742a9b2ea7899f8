"""How the natural frequencies of the modal model converge as it takes in more modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from trussflow.blocks.framework.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.modal_analysis.direct_fe import RigidRobot, all_modes_limit, direct_modes, rigid_robots
from trussflow.models.modal_analysis.locked_arms import locked_modes, truss_alone_modes
from trussflow.models.modal_analysis.natural_modes import SUPPORTS, Support
from trussflow.models.reporting.tables import text_table
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.truss.component_modes import component_modes
from trussflow.models.truss.truss_fe import TrussFrame
from trussflow.models.truss.truss_modes import TrussModes

NUMBERS_OF_MODES = (6, 8, 10, 14, 20, 30, 40)
"""Numbers of modes in the table unless others are asked for."""


def convergence(
    *,
    frame: TrussFrame | None = None,
    grasp_points: Vector | None = None,
    arms: Sequence[RobotArm] | None = None,
    joint_angles: Vector | None = None,
    numbers_of_modes: Sequence[int] = NUMBERS_OF_MODES,
    robot_scales: Sequence[float] = (0.0, 1.0),
    compared: int = 6,
) -> xr.Dataset:
    r"""Compare the modal model, for growing numbers of modes, with the direct FE model.

    The modes and their frequencies are those of `frame`, not the paper's printed ones, which
    lie 0.1 % higher, and the robots are on mesh points (the paper's grasp point 4 lies 0.5 mm
    beside one): so the modal model is a Rayleigh–Ritz approximation of the FE model, every
    frequency is an upper bound, and more modes lower it.

    Parameters
    ----------
    frame : TrussFrame, optional
        The truss; by default the reconstructed one.
    grasp_points : array, shape (k, 3), optional
        Each within 2 mm of a mesh point, to which it is moved; by default the paper's [m].
    arms : sequence of RobotArm, optional
        One per grasp point; by default the robot of the paper's Table 2 at each.
    joint_angles : array, shape (joints,), optional
        Of all robots; by default their rest angles [rad].
    numbers_of_modes : sequence of int
        Of the modal models, each at least one [-].
    robot_scales : sequence of float
        Factors on mass and inertia of all robots; zero for no robots [-].
    compared : int
        Number of elastic frequencies to compare [-].

    Returns
    -------
    xarray.Dataset
        Over ``support`` (free, clamped), ``robot_scale``, ``mode`` (from 1) and, the first one,
        ``number_of_modes``:

        ``frequency``
            Of the modal model; NaN beyond its number of modes [Hz].
        ``limit_frequency``
            Of the modal model with all modes (`all_modes_limit`) [Hz].
        ``direct_frequency``
            Of the finite-element model with rigid root face (`direct_modes`) [Hz].
        ``flexible_face_frequency``
            Of the same with flexible root face; NaN if clamped [Hz].
        ``component_frequency``
            Of the modal model with attachment shapes besides (`component_modes`) [Hz].
        ``error``
            ``frequency / direct_frequency - 1`` [1].
        ``component_error``
            ``component_frequency / direct_frequency - 1`` [1].
        ``truncation_error``
            ``frequency / limit_frequency - 1``, which more modes remove [1].
        ``basis_error``
            ``limit_frequency / direct_frequency - 1``, which they do not, but attachment shapes
            do [1].
        ``face_error``
            ``direct_frequency / flexible_face_frequency - 1`` [1].

    Raises
    ------
    ModelError
        If a grasp point is not at a mesh point, arms and grasp points are not equally many, or
        a number is out of its range.

    Notes
    -----
    Of the paper's truss with the true arms at rest, the first three free frequencies are 3 %
    high with six modes and still 0.2 to 2.2 % with forty: `basis_error` is what remains, since
    no mode of the truss alone bends the rods at a grasp point as a robot's torque does. It
    grows with the lever of the robots, to 12 % in the fourth. Attachment shapes do: with twenty
    modes besides, the first ten are within 0.11 %. The last frequencies of any modal model are of
    no use.
    """
    frame = TrussFrame.reconstructed() if frame is None else frame
    points = TrussModes.reconstructed().grasp_positions if grasp_points is None else grasp_points
    nodes = frame.mesh_points(points)
    robots = (RobotArm.literal(),) * len(nodes) if arms is None else tuple(arms)
    rest = np.concatenate([np.zeros(0), *(robot.rest_angles for robot in robots)])
    angles = rest if joint_angles is None else joint_angles
    _check(numbers_of_modes, robot_scales, compared)
    places = frame.point_masses()[0][nodes]
    plain = frame.modes(max(numbers_of_modes), places)
    trusses = [(plain.truncated(n), component_modes(frame, n, places)) for n in numbers_of_modes]
    fleets = [tuple(_scaled(robot, k) for robot in robots) if k else () for k in robot_scales]
    modal = [
        [
            [[_modal(truss, fleet, angles, s, compared) for fleet in fleets] for s in SUPPORTS]
            for truss in of_one_number
        ]
        for of_one_number in trusses
    ]
    bodies = [rigid_robots(fleet, angles, nodes) if fleet else () for fleet in fleets]
    direct = [[_direct(frame, robots, s, compared) for robots in bodies] for s in SUPPORTS]
    masses = [sum(robot.mass for robot in fleet) for fleet in fleets]
    return _dataset(np.array(modal), np.array(direct), numbers_of_modes, robot_scales, masses)


def convergence_text(comparison: xr.Dataset) -> str:
    """Return the comparison as tables for people: one per support and set of robots.

    Parameters
    ----------
    comparison : xarray.Dataset
        From `convergence`.

    Returns
    -------
    str
        Relative errors in percent, per number of modes and natural frequency; at last with
        attachment shapes.
    """
    header = ["", *(f"f{k}" for k in comparison["mode"].values)]
    tables = []
    for support in comparison["support"].values:
        for scale in comparison["robot_scale"].values:
            case = comparison.sel(support=support, robot_scale=scale)
            rows = [
                ["direct FE [Hz]", *(f"{f:.4f}" for f in case["direct_frequency"].values)],
                *(
                    [f"{n} modes", *_percents(case["error"].sel(number_of_modes=n).values)]
                    for n in case["number_of_modes"].values
                ),
                ["all modes", *_percents(case["basis_error"].values)],
            ]
            if support == "free":
                rows.append(["rigid root face", *_percents(case["face_error"].values)])
            for n in case["number_of_modes"].values:
                errors = case["component_error"].sel(number_of_modes=n).values
                rows.append([f"{n} + shapes", *_percents(errors)])
            robots = f"robots of {float(case['robot_mass']):.3g} kg in all" if scale else "no robots"
            tables.append(f"{support}, {robots}\n{text_table(header, rows)}")
    return "\n\n".join(tables)


def summary_text(comparison: xr.Dataset, first: int = 3) -> str:
    """Return how the largest error falls with the number of modes, a line per set of robots.

    Parameters
    ----------
    comparison : xarray.Dataset
        From `convergence`.
    first : int
        How many of the lowest frequencies count [-].

    Returns
    -------
    str
        Relative errors in percent.
    """
    lowest = comparison.sel(mode=slice(1, first))
    numbers = comparison["number_of_modes"].values
    header = ["support", "robots [kg]", *(f"{n} modes" for n in numbers), "all modes"]
    worst = lowest["error"].max("mode", skipna=False)
    limit = lowest["basis_error"].max("mode")
    rows = [
        [
            str(support),
            f"{float(comparison['robot_mass'].sel(robot_scale=scale)):.3g}",
            *_percents(worst.sel(support=support, robot_scale=scale).values),
            *_percents([float(limit.sel(support=support, robot_scale=scale))]),
        ]
        for support in comparison["support"].values
        for scale in comparison["robot_scale"].values
    ]
    title = f"largest error of the {first} lowest frequencies"
    return f"{title}\n{text_table(header, rows)}"


def _check(numbers: Sequence[int], scales: Sequence[float], compared: int) -> None:
    """Raise unless the ranges of the table make sense; a mesh limits the modes by itself."""
    if not numbers or min(numbers) < 1:
        raise ModelError(f"numbers_of_modes is {list(numbers)}; give at least one, each 1 or more")
    if not scales or not all(0.0 <= scale < np.inf for scale in scales):
        raise ModelError(f"robot_scales is {list(scales)}; give at least one, each 0 or more")
    if compared < 1:
        raise ModelError(f"compared is {compared}; compare at least one frequency")


def _scaled(arm: RobotArm, factor: float) -> RobotArm:
    """Return an arm of the same shape with all masses and inertias times a factor."""
    return replace(
        arm,
        masses=factor * arm.masses,
        static_moments=factor * arm.static_moments,
        inertias=factor * arm.inertias,
        base_mass=factor * arm.base_mass,
        base_inertia=factor * arm.base_inertia,
    )


def _modal(
    truss: TrussModes, arms: tuple[RobotArm, ...], angles: Vector, support: Support, count: int
) -> Vector:
    """Return the first frequencies of the modal model, NaN beyond what it has, (count,) [Hz]."""
    if arms:
        dynamics = TrussDynamics(modes=truss, arms=arms, elastic_integrals=True)
        found = locked_modes(dynamics, support, angles).frequencies[:count]
    else:
        found = truss_alone_modes(truss, support).frequencies[:count]
    return np.concatenate([found, np.full(count - len(found), np.nan)])


def _direct(frame: TrussFrame, robots: Sequence[RigidRobot], support: Support, count: int) -> Vector:
    """Return the frequencies of the three finite-element models, (3, count) [Hz].

    In this order: the limit of the modal model, rigid root face, flexible root face.
    """
    flexible = np.full(count, np.nan)
    if support == "free":
        flexible = direct_modes(frame, robots, support, count, flexible_face=True).frequencies
    limit = all_modes_limit(frame, robots, support, count).frequencies
    return np.stack([limit, direct_modes(frame, robots, support, count).frequencies, flexible])


def _dataset(
    modal: Vector, direct: Vector, numbers: Sequence[int], scales: Sequence[float], masses: Sequence[float]
) -> xr.Dataset:
    """Return the frequencies and their relative differences, named and with units."""
    case = ("support", "robot_scale", "mode")
    data = xr.Dataset(
        {
            "frequency": (("number_of_modes", *case), modal[:, 0]),
            "component_frequency": (("number_of_modes", *case), modal[:, 1]),
            "limit_frequency": (case, direct[:, :, 0]),
            "direct_frequency": (case, direct[:, :, 1]),
            "flexible_face_frequency": (case, direct[:, :, 2]),
        },
        coords={
            "number_of_modes": list(numbers),
            "support": list(SUPPORTS),
            "robot_scale": [float(scale) for scale in scales],
            "robot_mass": ("robot_scale", list(masses), {"units": "kg", "long_name": "all robots"}),
            "mode": np.arange(1, modal.shape[-1] + 1),
        },
    )
    data["error"] = data["frequency"] / data["direct_frequency"] - 1.0
    data["component_error"] = data["component_frequency"] / data["direct_frequency"] - 1.0
    data["truncation_error"] = data["frequency"] / data["limit_frequency"] - 1.0
    data["basis_error"] = data["limit_frequency"] / data["direct_frequency"] - 1.0
    data["face_error"] = data["direct_frequency"] / data["flexible_face_frequency"] - 1.0
    for name, variable in data.data_vars.items():
        variable.attrs["units"] = "Hz" if str(name).endswith("frequency") else "1"
    return data


def _percents(errors: Vector | Sequence[float]) -> list[str]:
    """Return relative errors as percent, a dash where there is none."""
    # Adding zero turns -0.000 into 0.000: the sign of round-off means nothing.
    return ["-" if np.isnan(e) else f"{round(100.0 * e, 3) + 0.0:.3f} %" for e in errors]
