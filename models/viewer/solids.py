"""Visuals of robots as triangles for the page, simplified if there are too many."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.robots.visuals import BOX_CORNERS, BOX_FACES, Triangles

MAX_TRIANGLES = 12_000
"""Largest number of triangles of all robots of a run [-]."""

_FINEST, _COARSER = 1e-3, 1.3  # edge of clustering cells [m], and its growth factor [-]


class Solid(NamedTuple):
    """Triangles that move with the bodies of a robot.

    Attributes
    ----------
    points : array, shape (k, 3)
        Corners, in the frame of their body [m].
    bodies : array, shape (k,)
        Index of the body of each corner: 0 is the hand, then the links [-].
    faces : array, shape (m, 3)
        Indices of the corners of each triangle [-].
    troubles : tuple of str
        Reasons why visuals are omitted.
    """

    points: Vector
    bodies: NDArray[np.int_]
    faces: NDArray[np.int_]
    troubles: tuple[str, ...] = ()


def solid_of(arm: RobotArm, most: int) -> Solid:
    """Return the solid of a robot; without visuals, a box around its base.

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
    if not parts:
        corners = (
            arm.base_position + (2.0 * BOX_CORNERS * box_of(arm)) @ arm.base_rotation.T
        )
        return Solid(
            corners, np.full(len(corners), arm.joints), BOX_FACES, tuple(troubles)
        )
    edge, found = _FINEST, [triangles for _, triangles in parts]
    while sum(len(faces) for _, faces in found) > most:
        found, edge = (
            [_merged(triangles, edge) for _, triangles in parts],
            edge * _COARSER,
        )
    starts = np.cumsum([0, *(len(points) for points, _ in found)])
    return Solid(
        np.concatenate([points for points, _ in found]),
        np.repeat([body for body, _ in parts], np.diff(starts)),
        np.concatenate(
            [faces + start for (_, faces), start in zip(found, starts, strict=False)]
        ),
        tuple(troubles),
    )


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
