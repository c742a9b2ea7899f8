"""Base class of linear blocks, and checks of matrices and transfer functions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array


class Linear(Block):
    """Base of blocks with the matrices A, B, C, D.

    Parameters
    ----------
    A, B, C, D : array_like
        The matrices [any].
    initial_value : array_like, shape (n,)
        Initial state [any].
    input_unit, output_unit : str, tuple of str or None
        Units of u and y, or one per element; None leaves them unchecked.
    """

    u = Input("input_shape", unit=Attribute("input_unit"), meaning="input")
    y = Output("output_shape", unit=Attribute("output_unit"), meaning="output")
    x = State("order", initial="initial_value", meaning="state")
    initial_value = Parameter(shape="order", meaning="initial state")

    def __init__(
        self,
        A: npt.ArrayLike,
        B: npt.ArrayLike,
        C: npt.ArrayLike,
        D: npt.ArrayLike = 0.0,
        *,
        initial_value: npt.ArrayLike = 0.0,
        input_unit: Unit = None,
        output_unit: Unit = None,
    ) -> None:
        self.A, self.B, self.C, self.D = matrices(type(self).__name__, A, B, C, D)
        self.order = self.A.shape[0]
        self.input_shape, self.output_shape = self.B.shape[1:], self.C.shape[:-1]
        self.input_unit, self.output_unit = input_unit, output_unit
        super().__init__(initial_value=initial_value)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return C x + D u."""
        return {"y": self.C @ x.x + self._times_input(self.D, u)}

    def _next(self, x: Signals, u: Signals) -> Array:
        """Return A x + B u."""
        return self.A @ x.x + self._times_input(self.B, u)

    def _times_input(self, matrix: Vector, u: Signals) -> Array:
        """Return a matrix times the input; for a scalar input, the matrix is a vector."""
        return matrix @ u.u if self.input_shape else matrix * u.u


def matrices(
    owner: str, A: npt.ArrayLike, B: npt.ArrayLike, C: npt.ArrayLike, D: npt.ArrayLike
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return the checked matrices of a linear system.

    Parameters
    ----------
    owner : str
        Name of the block, for messages.
    A, B, C, D : array_like
        The matrices [any]; B is a vector for a scalar input, and C for a scalar output.
        A scalar D is broadcast to all elements.

    Raises
    ------
    BlockError
        If sizes do not fit, or an element is not finite.
    """
    given = zip("ABCD", (A, B, C, D), strict=True)
    a, b, c, d = found = [
        finite_array(f"{name} of {owner}", value) for name, value in given
    ]
    for matrix in found:
        # Compiled code contains the matrices: a later change would have no effect.
        matrix.setflags(write=False)
    n = len(a) if a.ndim else 0
    if a.shape != (n, n) or not n:
        raise BlockError(
            f"{owner}: A has shape {a.shape}; it must be square, with at least one state"
        )
    if b.ndim not in (1, 2) or b.shape[0] != n:
        raise BlockError(
            f"{owner}: B has shape {b.shape}; with {n} states it must have shape ({n}, inputs), "
            f"or ({n},) for a scalar input"
        )
    if c.ndim not in (1, 2) or c.shape[-1] != n:
        raise BlockError(
            f"{owner}: C has shape {c.shape}; with {n} states it must have shape (outputs, {n}), "
            f"or ({n},) for a scalar output"
        )
    wanted = (*c.shape[:-1], *b.shape[1:])
    if d.shape not in ((), wanted):
        raise BlockError(f"{owner}: D has shape {d.shape}; B and C require {wanted}")
    return a, b, c, np.broadcast_to(d, wanted)


def realization(
    owner: str, numerator: npt.ArrayLike, denominator: npt.ArrayLike
) -> tuple[Vector, Vector, Vector, Vector]:
    r"""Return A, B, C, D of a transfer function, in controllable canonical form.

    Parameters
    ----------
    owner : str
        Name of the block, for messages.
    numerator, denominator : array_like
        Coefficients, highest power first [any].

    Raises
    ------
    BlockError
        If the coefficients are not vectors, the denominator is zero or constant, or the
        numerator has a higher order.
    """
    polynomials = []
    for name, value in (("numerator", numerator), ("denominator", denominator)):
        coefficients = np.atleast_1d(finite_array(f"the {name} of {owner}", value))
        if coefficients.ndim != 1:
            raise BlockError(f"{owner}: the {name} must be a list of coefficients")
        # Leading zeros would count for the order and make the denominator's first
        # coefficient, by which all are divided, zero.
        polynomials.append(np.trim_zeros(coefficients, "f"))
    num, den = polynomials
    n = den.size - 1
    if n < 1:
        raise BlockError(
            f"{owner}: the denominator {np.asarray(denominator).tolist()} has no pole; use a Gain"
        )
    if num.size > den.size:
        raise BlockError(
            f"{owner}: the numerator has order {num.size - 1}, the denominator {n}; a transfer "
            "function that differentiates cannot be simulated"
        )
    num = np.concatenate([np.zeros(n + 1 - num.size), num]) / den[0]
    den = den / den[0]
    # The first state has the highest derivative, the others are its integrals. D is the
    # quotient of the leading coefficients, C the remainder of the polynomial division.
    A = np.eye(n, k=-1)
    A[0] = -den[1:]
    B = np.eye(n)[0]
    C = num[1:] - num[0] * den[1:]
    return A, B, C, num[0]
