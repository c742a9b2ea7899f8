"""Equations of Python blocks as functions of vectors, and their derivatives: the block's own, or differences.

A Python block with known derivatives has a method::

    def directional_derivative(self, kind, t, x, u, p, dx, du):
        return {"y": 2.0 * u.u * du.u}

that returns the derivatives of the values of an equation along the direction dx, du of states x
and inputs u. `kind` is the equation: ``"output"``, ``"update"`` or ``"derivative"``. All are
`Signals` of arrays by name. The result must be linear in dx and du.
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
"""Required relative accuracy of each derivative by differences [-]."""

REFUSE_ABOVE = 1e-4
"""Estimated error, relative to the largest derivative of the same value, above which differences
are refused [-]."""

MIN_RELATIVE_CHANGE = 1e-4
"""Relative change of a value, over a change of one, below which derivatives count as zero because
of the round-off of differences [-]."""


def offered(
    block: Block, equations: Equations | None = None
) -> Callable[..., Values] | None:
    """Return the directional derivatives of a `block` itself, or of its `equations` in a run."""
    for item in (equations, block):
        # On the type: for an instance, `Block.__getattr__` would look for a port.
        own: Callable[..., Values] | None = getattr(
            type(item), "directional_derivative", None
        )
        if own is not None:
            bound: Callable[..., Values] = own.__get__(item)
            return bound
    return None


def hiding(system: System) -> list[Block]:
    """Return the sampled Python blocks with undeclared states."""
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
        # SciPy asks for many points at once, shape (n, ...); a block takes one.
        columns = points.reshape(point.size, -1)
        values = np.stack([function(column) for column in columns.T], axis=-1)
        return values.reshape(base.size, *points.shape[1:])

    # The first step is large, as SciPy halves it until two estimates agree.
    steps = np.maximum(np.abs(point), 1.0) * 1e-2
    with warnings.catch_warnings():
        # SciPy divides 0 by 0 where a derivative is zero.
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
    # An estimate of NaN is no agreement: it must not pass the comparison below.
    error = float(np.nan_to_num(found.error / scale[:, None], nan=np.inf).max())
    if not np.isfinite(found.df).all() or error > REFUSE_ABOVE:
        raise LinearAnalysisError(
            f"cannot differentiate Python block '{block.path}' ({type(block).__name__}): "
            f"differences of its equations disagree by {error:.1g} of their size, as at a step or "
            "a kink; linearize elsewhere, or give the block a method directional_derivative()"
        )
    return np.asarray(found.df), error
