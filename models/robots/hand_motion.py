"""Motion of a robot's hand, which is fixed to a grasp point of the flexible truss (Eqs. 32–35)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trussflow.blocks.support.types import Array
from trussflow.models.geometry.rotation import (
    cayley_bias_acceleration,
    cayley_rate_matrix,
    cayley_rotation,
    cross_matrix,
)
from trussflow.models.geometry.spatial import motion_product
from trussflow.models.truss.truss_modes import ModalData


class HandMotion(NamedTuple):
    r"""Position and motion of one hand, with spatial motions about :math:`O_t` in truss axes.

    Attributes
    ----------
    rotation : array, shape (3, 3)
        Elastic rotation of the truss at the grasp point.
    position : array, shape (3,)
        Grasp point with its elastic displacement, :math:`\rho` [m].
    modal_motion : array, shape (6, h)
        Motion of the hand relative to the truss frame per modal rate, :math:`\Phi` [kg^-½; rad/(kg^½·m)].
    velocity : array, shape (6,)
        Spatial velocity [m/s; rad/s].
    acceleration : array, shape (6,)
        Spatial acceleration at zero generalized accelerations [m/s²; rad/s²].
    """

    rotation: Array
    position: Array
    modal_motion: Array
    velocity: Array
    acceleration: Array


def hand_motion(
    truss: ModalData,
    grasp: int,
    modal_coordinates: Array,
    root_velocity: Array,
    modal_rates: Array,
    *,
    exact: bool,
) -> HandMotion:
    r"""Return the motion of the hand at a grasp point.

    With :math:`\rho = r + T\tau` and the elastic rotation :math:`c = R\tau`, the motion of the hand
    relative to the truss frame is :math:`[T + \rho^\times \Gamma;\; \Gamma]\,\dot\tau`.

    Parameters
    ----------
    truss : ModalData
        Data of the truss with h modes.
    grasp : int
        Index of the grasp point.
    modal_coordinates : array, shape (h,)
        :math:`\tau` [kg^½·m].
    root_velocity : array, shape (6,)
        Velocity and angular velocity of the truss frame, in truss axes [m/s; rad/s].
    modal_rates : array, shape (h,)
        :math:`\dot\tau` [kg^½·m/s].
    exact : bool
        False: :math:`\Gamma = R`, as published. True: :math:`\Gamma = B(c) R`, exact. The difference is
        of the order of :math:`c`.

    Returns
    -------
    HandMotion

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 32–35.
    """
    translation, turning = truss.grasp_translations[grasp], truss.grasp_rotations[grasp]
    position = truss.grasp_positions[grasp] + translation @ modal_coordinates
    rotation_vector = turning @ modal_coordinates
    # The published Gamma = R is constant, so that its rate adds no bias.
    turn_acceleration = np.zeros(3)
    if exact:
        turn_acceleration = cayley_bias_acceleration(
            rotation_vector, turning @ modal_rates
        )
        turning = cayley_rate_matrix(rotation_vector) @ turning
    # Spatial velocity at O_t: T - Gamma x rho = T + rho x Gamma (Eqs. 33 and 35).
    lever = cross_matrix(position)
    modal_motion = np.concatenate([translation + lever @ turning, turning])
    relative = modal_motion @ modal_rates
    # Rate of the relative motion by the motion of the grasp point and the rate of Gamma.
    point_acceleration = np.cross(translation @ modal_rates, turning @ modal_rates)
    own = np.concatenate(
        [point_acceleration + lever @ turn_acceleration, turn_acceleration]
    )
    return HandMotion(
        rotation=cayley_rotation(rotation_vector),
        position=position,
        modal_motion=modal_motion,
        velocity=root_velocity + relative,
        acceleration=motion_product(root_velocity, relative) + own,
    )
