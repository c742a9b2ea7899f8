"""Derivatives of Python blocks: the block's own, or differences with error control."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.errors import LinearAnalysisError
from trussflow.blocks.framework.types import Vector

RELATIVE_TOLERANCE = 1e-8
"""Wanted of differences, relative to the largest derivative of the same output."""

WARN_ABOVE = 1e-4
"""Estimated relative error that is no longer a derivative worth the name."""


def differences(
    block: Block, function: Callable[[Vector], Vector], point: Vector
) -> tuple[Vector, float]:
    """Return the Jacobian of a function by central differences of rising order.

    Parameters
    ----------
    block : Block
        Whose function it is, for messages.
    function : callable
        Maps a vector to a vector.
    point : Vector
        Where [any].

    Returns
    -------
    Vector, float
        The Jacobian, and its estimated error relative to its largest element [-].

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
        warnings.simplefilter("ignore", RuntimeWarning)  # of 0 / 0 where a derivative is zero
        found = jacobian(
            each, point, initial_step=steps, tolerances={"rtol": RELATIVE_TOLERANCE, "atol": 1e-14}
        )
    scale = max(np.abs(found.df).max(), np.abs(base).max() * 1e-12, 1e-300)
    error = float(np.nan_to_num(found.error / scale, nan=np.inf).max())
    if not np.isfinite(found.df).all() or error > WARN_ABOVE:
        raise LinearAnalysisError(
            f"cannot differentiate Python block '{block.path}' ({type(block).__name__}): "
            f"differences of its equations disagree by {error:.1g} of their size, as at a step or "
            "a kink; linearize at another point, or give the block a method jacobian()"
        )
    return np.asarray(found.df), error
