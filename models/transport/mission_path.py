"""Path of a mission file: waypoints, fastest duration within actuator limits, input shaping."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trussflow.blocks.control.input_shaping import SHAPERS, ShapedTrajectory
from trussflow.blocks.control.trajectory import Quintic, Trajectory
from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.task_space import moved
from trussflow.models.feasibility import TrussPath, fastest
from trussflow.models.geometry.attitude import EULER
from trussflow.models.layered_file import LayeredFile, LayeredTable
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.transport.mission import FASTEST, Mission

MAX_LEG_ANGLE = np.pi / 2.0
"""Largest rotation between waypoints of a quaternion path; longer legs are divided [rad]."""

DEFAULT_STRENGTH = 0.5
"""Default share of the actuator limits for the fastest path; the rest is for feedback [-]."""

WAYPOINT_UNITS = {"position": "m", "attitude": "rad"}


def path_from(
    file: LayeredFile, mission: Mission, truss: SpaceTruss, limits: Vector
) -> tuple[Mission, Trajectory | None]:
    """Return the mission with the duration of its path, and the path, or None for a single `Quintic`.

    Parameters
    ----------
    file : LayeredFile
        File with the table ``[path]``.
    mission : Mission
        Mission of that file.
    truss : SpaceTruss
        Nominal plant.
    limits : Vector, shape (actuators,)
        Limit of each actuator [N, N·m].

    Raises
    ------
    ModelError
        If a value of the table is invalid, or the actuators cannot move the truss along the path.
    """
    table = file.table("path")
    ways = _waypoints(table)
    shaping = (
        table.choice("shaping", ("none", *SHAPERS)) if "shaping" in table else "none"
    )
    given = table.optional(strength="1", speed="m/s", turn_rate="rad/s")
    if mission.duration < np.inf and not given and len(ways) == 2 and shaping == "none":
        return mission, None
    kind = truss.dynamics.attitude
    if kind != EULER and shaping != "none":
        raise table.error(
            "shaping", "adds paths, which is not possible with quaternions; omit it"
        )
    for key, most in {"strength": 1.0, "speed": np.inf, "turn_rate": np.inf}.items():
        if not 0.0 < given.get(key, most) <= most:
            raise table.error(
                key,
                f"is {given[key]:g}; it must be above 0"
                + " and at most 1" * (most == 1.0),
            )
    ways = np.pad(
        ways if kind == EULER else _by_quarters(ways), ((0, 0), (0, truss.joints))
    )
    rows = np.array([moved(kind, truss.start_position, way) for way in ways])
    far = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(ways, axis=0), axis=1)))
    if len(rows) > 2 and not np.all(np.diff(far) > 0.0):
        raise table.error("through_position", "has two equal waypoints in succession")
    if mission.duration == np.inf:
        share = given.get("strength", DEFAULT_STRENGTH)
        limit = [given.get(key, np.inf) for key in ("speed", "turn_rate")]
        with file.blamed("path", "duration"):
            path: Trajectory = fastest(
                truss, rows[:, : kind.end], share * limits, velocity=np.repeat(limit, 3)
            )
    elif given:
        raise table.error(
            min(given), f"requires duration = {FASTEST!r}; omit it otherwise"
        )
    elif len(rows) > 2:
        path = TrussPath.through(truss, mission.duration * far / far[-1], rows)
    else:
        path = Quintic(
            rows[1] - rows[0], mission.duration, start=rows[0], unit=truss.task_units
        )
    if shaping != "none":
        if not truss.modes:
            raise table.error("shaping", "needs a mode, and this truss has none")
        free = FreeModes.of(truss.dynamics, 1)
        first, damping = (
            float(free.frequencies[0]) / (2.0 * np.pi),
            float(free.damping_ratios[0]),
        )
        path = ShapedTrajectory(path, first, damping=damping, kind=shaping)
    return replace(mission, duration=max(path.breakpoints())), path


def _by_quarters(ways: Vector) -> Vector:
    """Return waypoints with legs of at most `MAX_LEG_ANGLE`."""
    found = [ways[:1]]
    for here, leg in zip(ways[:-1], np.diff(ways, axis=0), strict=True):
        parts = max(1, int(np.ceil(np.linalg.norm(leg[3:]) / MAX_LEG_ANGLE)))
        found.append(here + leg * np.arange(1, parts + 1)[:, None] / parts)
    return np.concatenate(found)


def _waypoints(table: LayeredTable) -> Vector:
    """Return the waypoints, start included, as rows of displacement and rotation."""
    parts = []
    for key, unit in WAYPOINT_UNITS.items():
        name, end = f"through_{key}", table.array(key, unit, (3,))
        between = (
            table.array(name, unit, (None, 3)) if name in table else np.zeros((0, 3))
        )
        parts.append(np.vstack([np.zeros(3), between, end]))
    position, attitude = parts
    if len(position) != len(attitude):
        name = (
            "through_position" if len(position) > len(attitude) else "through_attitude"
        )
        raise table.error(
            name,
            f"has {abs(len(position) - len(attitude))} more rows than the other of through_position and "
            "through_attitude; both must have the same number",
        )
    return np.hstack(parts)
