"""Equations of Python blocks as functions of vectors, and their derivatives: the block's own, or differences.

A Python block that knows its derivatives offers them by a method::

    def directional_derivative(self, kind, t, x, u, p, dx, du):
        return {"y": 2.0 * u.u * du.u}

that returns how the values of an equation change with states x and inputs u along the direction
dx, du; `kind` says which: ``"output"``, ``"update"`` or ``"derivative"``. All are `Signals` of
arrays by name. It must be linear in dx and du.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.system import System
from trussflow.blocks.support.types import Vector

RELATIVE_TOLERANCE = 1e-8
"""Wanted of differences, of each derivative [-]."""

REFUSE_ABOVE = 1e-4
"""Estimated error, relative to the largest derivative of the same value, that is no longer a
derivative worth the name [-]."""

MIN_RELATIVE_CHANGE = 1e-4
"""Derivatives that change a value by less than this part of it, over a change of one, are not
told from zero: differences have round-off [-]."""


def offered(
    block: Block, equations: Equations | None = None
) -> Callable[..., Values] | None:
    """Return the directional derivatives of a `block` itself, or of its `equations` in a run."""
    for item in (equations, block):
        own: Callable[..., Values] | None = getattr(
            type(item), "directional_derivative", None
        )
        if own is not None:
            bound: Callable[..., Values] = own.__get__(item)
            return bound
    return None


def hiding(system: System) -> list[Block]:
    """Return the sampled Python blocks whose response to their inputs is not in what they declare."""
    return [
        b
        for b in system.blocks.values()
        if b.hides and b.outputs() and not b.continuous
    ]


def refuse_hidden(system: System) -> None:
    """Raise `LinearAnalysisError` for blocks whose response to their inputs is unknown.

    Raises
    ------
    LinearAnalysisError
        If a block with outputs keeps something besides its states, and does not offer derivatives.
    """
    for block in hiding(system):
        if offered(block) is None:
            raise LinearAnalysisError(
                f"cannot linearize Python block '{block.path}' ({type(block).__name__}): it keeps "
                "something besides its declared states; declare it as states, or give the block a "
                "method directional_derivative()"
            )


def differences(
    block: Block, function: Callable[[Vector], Vector], point: Vector
) -> tuple[Vector, float]:
    """Return the Jacobian of a function by central differences of rising order.

    Parameters
    ----------
    block : Block
        Block of the function, for messages.
    function : callable
        Maps a vector to a vector.
    point : Vector
        Point of the differentiation [any].

    Returns
    -------
    Vector, float
        The Jacobian, and its estimated error relative to the largest element of the same row [-].

    Raises
    ------
    LinearAnalysisError
        If the differences do not converge: the function has a step or a kink there.
    """
    from scipy.differentiate import jacobian  # takes a while to import

    base = function(point)
    if not point.size or not base.size:
        return np.zeros((base.size, point.size)), 0.0

    def each(points: Vector) -> Vector:
        columns = points.reshape(point.size, -1)
        values = np.stack([function(column) for column in columns.T], axis=-1)
        return values.reshape(base.size, *points.shape[1:])

    steps = np.maximum(np.abs(point), 1.0) * 1e-2
    with warnings.catch_warnings():
        # of 0 / 0 where a derivative is zero
        warnings.simplefilter("ignore", RuntimeWarning)
        found = jacobian(
            each,
            point,
            initial_step=steps,
            tolerances={"rtol": RELATIVE_TOLERANCE, "atol": 1e-14},
        )
    scale = np.maximum(
        np.abs(found.df).max(axis=1), MIN_RELATIVE_CHANGE * np.abs(base) + 1e-300
    )
    error = float(np.nan_to_num(found.error / scale[:, None], nan=np.inf).max())
    if not np.isfinite(found.df).all() or error > REFUSE_ABOVE:
        raise LinearAnalysisError(
            f"cannot differentiate Python block '{block.path}' ({type(block).__name__}): "
            f"differences of its equations disagree by {error:.1g} of their size, as at a step or "
            "a kink; linearize elsewhere, or give the block a method directional_derivative()"
        )
    return np.asarray(found.df), error
