r"""Terms of the flexible truss in the equations of the system."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trussflow.blocks.support.types import Array
from trussflow.models.geometry.spatial import SpatialInertia, inertia_matrix
from trussflow.models.truss.truss_modes import ModalData, axial


class TrussTerms(NamedTuple):
    r"""Mass matrix and bias of the truss, in the order (velocity, angular velocity; modes).

    Attributes
    ----------
    root : array, shape (6, 6)
        Rigid part of the mass matrix [kg, kg·m, kg·m²].
    coupling : array, shape (6, h)
        :math:`[P; H]` [kg^½; kg^½·m]. The modal part of the mass matrix is the identity.
    root_bias : array, shape (6,)
        Rigid rows of the bias [N; N·m].
    modal_bias : array, shape (h,)
        Modal rows of the bias [N/kg^½].
    """

    root: Array
    coupling: Array
    root_bias: Array
    modal_bias: Array


def truss_terms(
    truss: ModalData,
    deformation: Array,
    velocity: Array,
    angular_velocity: Array,
    modal_rates: Array,
) -> TrussTerms:
    r"""Return the terms of the truss in mass matrix and bias.

    With :math:`a = \omega \times v` the rows of the bias are

    .. math::
        &m a + \omega \times (\omega \times S) + 2\,\omega \times P \dot\tau \\
        &S \times a + \omega \times J \omega + 2 H_\omega \dot\tau \\
        &P^T a + F_{\omega\omega} + 2 F_\omega \dot\tau

    where :math:`\rho = r` (published) or :math:`\rho = r + T\tau` (exact) in

    .. math::
        S = \int \rho\,dm,\quad P = \int T\,dm,\quad J = \int (\rho^T\rho I - \rho\rho^T)\,dm,
        \quad H = \int \rho \times T\,dm, \\
        H_\omega \dot\tau = \int \rho \times (\omega \times T\dot\tau)\,dm,\quad
        F_\omega \dot\tau = \int T^T (\omega \times T\dot\tau)\,dm,\quad
        F_{\omega\omega} = \int T^T (\omega \times (\omega \times \rho))\,dm.

    Parameters
    ----------
    truss : ModalData
        Data of the truss with h modes.
    deformation : array, shape (1,) or (1 + h,)
        Coefficients of the position in the integrals: ``[1]`` for the undeformed truss, ``[1, tau]``
        for the deformed one, :math:`\rho = r + T \tau` [1; kg^½·m].
    velocity, angular_velocity : array, shape (3,)
        Velocities of the truss frame, in truss axes [m/s, rad/s].
    modal_rates : array, shape (h,)
        :math:`\dot\tau` [kg^½·m/s].

    Returns
    -------
    TrussTerms

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 18, 19, 21, with the undeformed position only.
    """
    h = modal_rates.shape[0]
    omega = angular_velocity
    used = deformation.shape[0]
    # moments[b] = integral of rho T_b^T, with T_0 the undeformed position.
    flat = deformation @ truss.second_moments[:used]
    moments = [np.reshape(flat[9 * b : 9 * b + 9], (3, 3)) for b in range(h + 1)]
    static_moment = deformation @ truss.first_moments[:used]
    spread = sum(deformation[b] * moments[b] for b in range(used))
    inertia = np.trace(spread) * np.eye(3) - spread
    linear = truss.first_moments[1:].T
    body = SpatialInertia(truss.mass, static_moment, inertia)
    acceleration = np.cross(omega, velocity)
    root_bias = np.concatenate(
        [
            truss.mass * acceleration + np.cross(omega, np.cross(omega, static_moment)),
            np.cross(static_moment, acceleration) + np.cross(omega, inertia @ omega),
        ]
    )
    if h == 0:  # np.stack needs at least one array
        return TrussTerms(
            inertia_matrix(body), np.zeros((6, 0)), root_bias, np.zeros(0)
        )

    # flow = integral of rho (T tau')^T; then H_w tau' = w tr(flow) - flow^T w.
    flow = sum(modal_rates[b] * moments[b + 1] for b in range(h))
    coriolis = np.concatenate(
        [np.cross(omega, linear @ modal_rates), omega * np.trace(flow) - flow.T @ omega]
    )
    centrifugal = np.stack(
        [omega @ m @ omega - (omega @ omega) * np.trace(m) for m in moments[1:]]
    )
    swirl = _swirl(truss, h) @ np.reshape(np.outer(modal_rates, omega), (3 * h,))
    angular = np.stack([axial(m) for m in moments[1:]]).T
    return TrussTerms(
        root=inertia_matrix(body),
        coupling=np.concatenate([linear, angular]),
        root_bias=root_bias + 2.0 * coriolis,
        modal_bias=linear.T @ acceleration + centrifugal + 2.0 * swirl,
    )


def _swirl(truss: ModalData, h: int) -> Array:
    r"""Return the constant matrix of :math:`F_\omega \dot\tau`, from products of modal and angular rates.

    Element (a, (b, i)) is component i of :math:`\int T_b \times T_a\,dm`, since
    :math:`T_a \cdot (\omega \times T_b) = \omega \cdot (T_b \times T_a)`.
    """
    blocks = [
        [row[9 * a : 9 * a + 9] for a in range(1, h + 1)]
        for row in truss.second_moments[1:]
    ]
    rows = [[axial(np.reshape(row[a], (3, 3))) for row in blocks] for a in range(h)]
    return np.stack([np.concatenate(row) for row in rows])
