"""Visuals of robots as triangles for the page, simplified if there are too many."""

from __future__ import annotations

from typing import Any

import numpy as np

from trussflow.blocks.support.packing import packed
from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.robots.visuals import BOX_CORNERS, BOX_FACES, Triangles

MAX_TRIANGLES = 12_000
"""Largest number of triangles of all robots of a run [-]."""

POINT_BITS = 24
"""Mantissa bits of a corner, about seven decimal digits [-]."""

_FINEST, _COARSER = 1e-3, 1.3  # edge of clustering cells [m], and its growth factor [-]


def solid_of(arm: RobotArm, most: int) -> dict[str, Any]:
    """Return the solid of a robot as JSON; without visuals, a box around its base.

    It has whether visuals are drawn, the corners in the frames of their bodies [m], their bodies (0 is the hand,
    then the links), the corners of triangles, and the reasons why visuals are omitted.

    Parameters
    ----------
    arm : RobotArm
        Robot to draw.
    most : int
        Largest number of triangles; above it, close corners are merged [-].

    References
    ----------
    Rossignac, Borrel (1993), *Multi-resolution 3D approximations for rendering complex scenes*.
    """
    parts, troubles = [], []
    for visual in arm.visuals:
        try:
            parts.append((visual.body, visual.triangles()))
        except ModelError as error:
            troubles.append(str(error))
    bodies, found = [body for body, _ in parts], [triangles for _, triangles in parts]
    edge = _FINEST
    while sum(len(faces) for _, faces in found) > most:
        found = [_merged(triangles, edge) for _, triangles in parts]
        edge *= _COARSER
    if not parts:
        corners = 2.0 * BOX_CORNERS * box_of(arm) @ arm.base_rotation.T
        bodies, found = [arm.joints], [(arm.base_position + corners, BOX_FACES)]
    starts = np.cumsum([0, *(len(points) for points, _ in found)])
    shifted = [f + start for (_, f), start in zip(found, starts[:-1], strict=True)]
    return {
        "drawn": bool(parts),
        "points": packed(np.concatenate([points for points, _ in found]), POINT_BITS),
        "bodies": np.repeat(bodies, np.diff(starts)).tolist(),
        "faces": np.concatenate(shifted).T.tolist(),
        "troubles": [f"{arm.name} without {trouble}" for trouble in troubles],
    }


def box_of(arm: RobotArm) -> Vector:
    """Return half the sides of the uniform box with mass and inertia of the base, shape (3,) [m]."""
    moments = np.diag(arm.base_inertia)
    squares = 6.0 / arm.base_mass * (moments.sum() - 2.0 * moments)
    sides: Vector = np.sqrt(np.maximum(squares, 0.0))
    return sides / 2.0


def _merged(triangles: Triangles, edge: float) -> Triangles:
    """Return triangles with merged corners per cell, without degenerate and duplicate ones."""
    points, faces = triangles
    cells = np.rint((points - points.min(axis=0)) / edge).astype(np.int64)
    _, first, place = np.unique(
        cells @ [1, 1 << 21, 1 << 42], return_index=True, return_inverse=True
    )
    faces = place[faces]
    apart = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    _, one = np.unique(np.sort(faces[apart], axis=1), axis=0, return_index=True)
    return points[first], faces[apart][one]
