r"""Reduced models of the flexibility for control design.

At rest the plant is a rigid body and an elastic part in parallel. The modal coordinates obey

.. math:: \ddot\tau = -W (\Lambda \tau + D \dot\tau) + (M^{-1} P)_f\, Q, \qquad
          W = (M^{-1})_{ff},

whatever the rigid motion is, so the elastic part is stable and of order 2 h, and only it is
reduced. Two ways:

* modal truncation: keep the modes of largest gain, replace the others by their static response;
* balanced truncation: keep the states of largest Hankel singular value.

Sources: Moore (1981), *Principal component analysis in linear systems*; Glover (1984), *All
optimal Hankel-norm approximations*, for the bound; Gawronski (2004), *Advanced Structural
Dynamics and Active Control of Structures*, chapter 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import control
import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.modal_table import oscillating_modes
from trussflow.models.errors import ModelError
from trussflow.models.plant.space_truss import SpaceTruss


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reduction:
    r"""A reduced model, and how far it is from the full one.

    Attributes
    ----------
    model : control.StateSpace
        The reduced model.
    method : str
        ``"modal"`` or ``"balanced"``.
    order : int
        Its number of states [-].
    error : float
        :math:`\|G - G_r\|_\infty` [unit of the response].
    bound : float
        What the error is known not to exceed beforehand [unit of the response].
    """

    model: control.StateSpace
    method: str
    order: int
    error: float
    bound: float


def elastic_part(
    truss: SpaceTruss, actuators: slice | None = None, outputs: tuple[str, ...] | None = None
) -> control.StateSpace:
    """Return the elastic part of a plant at rest, of order twice the number of modes.

    Parameters
    ----------
    truss : SpaceTruss
        The plant.
    actuators : slice, optional
        Which of them; by default all.
    outputs : tuple of str, optional
        Ports that depend on the modal coordinates alone; by default the grasp displacements.

    Raises
    ------
    ModelError
        If an output is moved by the rigid motion too.
    """
    names = ["grasp_displacement"] if outputs is None else list(outputs)
    model = Linearizer(truss, ["actuation"], names).at()
    n, m = truss.n, truss.rigid
    elastic = np.concatenate([np.arange(m, n), np.arange(n + m, 2 * n)])
    rigid = np.setdiff1d(np.arange(2 * n), elastic)
    if np.any(model.C[:, rigid]) or np.any(model.D):
        raise ModelError(f"cannot take the elastic part of {', '.join(names)}: the rigid motion moves it too")
    B = model.B[elastic] if actuators is None else model.B[elastic][:, actuators]
    A, C = model.A[np.ix_(elastic, elastic)], model.C[:, elastic]
    return control.StateSpace(A, B, C, 0, outputs=model.output_labels, remove_useless_states=False)


def peak_gain(model: control.StateSpace) -> float:
    r"""Return :math:`\|G\|_\infty`, the largest singular value over all frequencies.

    Parameters
    ----------
    model : control.StateSpace
        A stable model.
    """
    if not model.nstates:
        return float(np.linalg.norm(model.D, 2))
    return float(control.linfnorm(model)[0])


def elastic_modes(model: control.StateSpace) -> list[control.StateSpace]:
    """Split an elastic model into its modes, of order two each, by frequency.

    Parameters
    ----------
    model : control.StateSpace
        Stable, with complex pairs of poles alone.

    Raises
    ------
    ModelError
        If a pole is real.
    """
    modes = sorted(oscillating_modes(model.A), key=lambda mode: abs(mode[0]))
    if 2 * len(modes) != model.nstates:
        raise ModelError("cannot split into modes: the elastic model has real poles")
    found = []
    for pole, left, right in modes:
        s, w = pole.real, pole.imag
        b, c = left @ model.B, model.C @ right
        # z = left x is complex; its real and imaginary part are the states.
        B = np.stack([b.real, b.imag])
        C = 2 * np.stack([c.real, -c.imag], axis=1)
        A = np.array([[s, -w], [w, s]])
        found.append(control.StateSpace(A, B, C, np.zeros_like(model.D), remove_useless_states=False))
    return found


def modal_truncation(model: control.StateSpace, order: int) -> Reduction:
    r"""Keep the modes of largest peak gain, and the static response of all others.

    Parameters
    ----------
    model : control.StateSpace
        An elastic model.
    order : int
        Number of states to keep, even [-].

    Returns
    -------
    Reduction
        Its bound is :math:`\sum \|G_i - G_i(0)\|_\infty` over the modes that are left out.

    Raises
    ------
    ModelError
        If the order is odd, or not between 0 and the model's own.
    """
    _check(model, order)
    if order % 2:
        raise ModelError(f"cannot keep {order} states of pairs; choose an even number")
    modes = elastic_modes(model)
    ranked = np.argsort([-peak_gain(mode) for mode in modes])
    kept = sorted(ranked[: order // 2])
    D: Vector = np.zeros_like(model.D)
    bound = 0.0
    for i in ranked[order // 2 :]:
        static = np.real(modes[i](0.0, squeeze=False))
        D = D + static
        A, B, C = modes[i].A, modes[i].B, modes[i].C
        bound += peak_gain(control.StateSpace(A, B, C, -static, remove_useless_states=False))
    reduced = control.StateSpace([], [], [], D)
    for i in kept:
        reduced = modes[i] + reduced
    return Reduction(
        model=reduced, method="modal", order=order, error=peak_gain(model - reduced), bound=bound
    )


def balanced_truncation(model: control.StateSpace, order: int) -> Reduction:
    r"""Keep the states of largest Hankel singular value.

    Parameters
    ----------
    model : control.StateSpace
        A stable model.
    order : int
        Number of states to keep [-].

    Returns
    -------
    Reduction
        Its bound is twice the sum of the Hankel singular values that are left out.

    Raises
    ------
    ModelError
        If the order is not between 0 and the model's own.
    """
    _check(model, order)
    values = control.hankel_singular_values(model).real  # roots of eigenvalues, complex by round-off
    reduced = control.balred(model, order)
    return Reduction(
        model=reduced,
        method="balanced",
        order=order,
        error=peak_gain(model - reduced),
        bound=float(2 * np.sum(values[order:])),
    )


def _check(model: control.StateSpace, order: int) -> None:
    if not 0 < order < model.nstates:
        raise ModelError(
            f"cannot reduce a model of {model.nstates} states to {order}; choose 1 to {model.nstates - 1}"
        )
