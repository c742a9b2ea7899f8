"""Geometry of a plant for the page: rods, mode shapes, arms, bases."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import ParameterError
from trussflow.blocks.support.packing import packed
from trussflow.blocks.support.validation import number_array
from trussflow.models.errors import ModelError
from trussflow.models.geometry.attitude import QUATERNION
from trussflow.models.plant.space_truss import STRUCTURES, SpaceTruss
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.truss.paper_truss import paper_structure
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.validation import frozen_array
from trussflow.models.viewer.solids import MAX_TRIANGLES, solid_of


def plant_of(truss: SpaceTruss | str | None, attributes: dict[str, Any]) -> SpaceTruss:
    """Return the plant of a run.

    Parameters
    ----------
    truss : SpaceTruss, str or None
        Plant, its name, or None for the name in the result.
    attributes : dict
        Attributes of the result; those of a mission include plant, arm and attitude.

    Raises
    ------
    ModelError
        If the plant is unknown.
    """
    if isinstance(truss, SpaceTruss):
        return truss
    name = attributes.get("plant") if truss is None else truss
    if name not in STRUCTURES:
        raise ModelError(
            f"cannot show the run: the plant is {name!r}, not one of {', '.join(STRUCTURES)}; open the "
            "index.html that its mission wrote, or give replay the SpaceTruss and its rods"
        )
    found: SpaceTruss = getattr(SpaceTruss, name)(arm=attributes.get("arm", "literal"))
    return (
        found.with_quaternion()
        if attributes.get("attitude") == QUATERNION.name
        else found
    )


def scene_of(truss: SpaceTruss, rods: npt.ArrayLike | None) -> dict[str, Any]:
    """Return the geometry of a plant.

    Parameters
    ----------
    truss : SpaceTruss
        Plant.
    rods : array_like, shape (k, 2), optional
        Pairs of point masses connected by a rod [-]; by default those of the reconstructed frame.

    Raises
    ------
    ModelError
        If rods are required but not given, or are not pairs of point masses.
    """
    modes, arms = truss.dynamics.modes, truss.dynamics.arms
    try:
        joined = frame_rods(modes) if rods is None else number_array("rods", rods)
    except ParameterError:
        joined = np.array([])
    places = range(len(modes.masses))
    if joined.shape[1:] != (2,) or not np.isin(joined, places).all():
        raise ModelError(
            f"cannot draw the truss: rods must be pairs of its {len(modes.masses)} points, counted from 0"
        )
    return {
        "points": packed(modes.positions),
        "shapes": packed(modes.shapes.reshape(len(modes.masses), -1)),
        "rods": joined.astype(int).tolist(),
        "arms": [
            _arm(modes, i, arm, MAX_TRIANGLES // len(arms))
            for i, arm in enumerate(arms)
        ],
    }


def target_of(truss: SpaceTruss, given: npt.ArrayLike | None) -> list[float] | None:
    """Return the task coordinates `given` of the target of a `truss` [m, rad], if there are any."""
    return (
        None if given is None else list(frozen_array("target", given, (truss.rigid_q,)))
    )


def frame_rods(modes: TrussModes) -> npt.NDArray[np.int_]:
    """Return the rods between the points of the reconstructed frame."""
    structure = paper_structure()
    positions = structure.points
    if (
        positions.shape != modes.positions.shape
        or np.abs(positions - modes.positions).max() > 1e-9
    ):
        raise ModelError(
            "cannot draw the truss: modal data do not say which points its rods join; give them as rods, "
            "pairs of points counted from 0"
        )
    return structure.rods(positions)


def _arm(
    modes: TrussModes, grasp: int, arm: RobotArm, triangles: int
) -> dict[str, Any]:
    """Return the geometry of an arm of at most so many `triangles` at the `grasp` [-]."""
    arrays = {
        "grasp": modes.grasp_positions[grasp],
        "translation": modes.grasp_translations[grasp],
        "rotation": modes.grasp_rotations[grasp],
        "hand": arm.hand_rotation,
        "basePosition": arm.base_position,
        "baseRotation": arm.base_rotation,
    }
    return {
        **{name: np.ravel(value).tolist() for name, value in arrays.items()},
        "origins": arm.joint_origins.tolist(),
        "sliding": list(arm.sliding),
        "rotations": arm.joint_rotations.reshape(-1, 9).tolist(),
        "solid": solid_of(arm, triangles),
    }
