"""Covariance matrices of Kalman filters: checks, exact sampling, steady state, observability."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log2

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import LinearAnalysisError, ParameterError
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import finite_array

ROUND_OFF = 1e-10
"""Relative tolerance below which asymmetry, eigenvalues and couplings of states count as zero [-]."""


def covariance(
    what: str, value: npt.ArrayLike, size: int, *, definite: bool = False
) -> Vector:
    """Return a covariance matrix, checked.

    Parameters
    ----------
    what : str
        Name of the matrix in messages.
    value : array_like
        A matrix, its diagonal, or one number for all of the diagonal [any].
    size : int
        Required number of rows [-].
    definite : bool
        Whether it must be positive definite, not only semidefinite.

    Raises
    ------
    ParameterError
        If it is not finite, has another shape, or is not symmetric or not positive (semi)definite.
    """
    matrix = finite_array(what, value)
    if matrix.shape not in ((), (size,), (size, size)):
        raise ParameterError(
            f"{what} has shape {matrix.shape}; give a matrix of shape ({size}, {size}), its diagonal of "
            f"{size} elements, or one number"
        )
    if matrix.ndim < 2:
        matrix = np.diag(np.broadcast_to(matrix, size))
    if (np.abs(matrix - matrix.T) > ROUND_OFF * np.abs(matrix).max(initial=0.0)).any():
        raise ParameterError(f"{what} is not symmetric: a covariance is")
    # In units of each diagonal element, so that metres do not hide nanometres.
    scale = np.sqrt(np.where(np.diag(matrix) > 0, np.diag(matrix), 1.0))
    smallest = np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min(initial=1.0)
    # Round-off can make zero eigenvalues of a semidefinite matrix slightly negative.
    if smallest < (ROUND_OFF if definite else -ROUND_OFF):
        raise ParameterError(
            f"{what} is not positive {'' if definite else 'semi'}definite: it must be"
        )
    return (matrix + matrix.T) / 2


def sampled_covariance(A: Vector, density: Vector, time: float) -> Vector:
    r"""Return the covariance that white noise adds to the state of a linear system within one sample.

    .. math:: Q_k = \int_0^T e^{A s} Q e^{A^T s} ds

    The integral is computed by one matrix exponential over a short time, which is then doubled repeatedly.

    Parameters
    ----------
    A, density : Vector
        System matrix, and the power spectral density Q of the noise in its rates [1/s, any].
    time : float
        T [s].

    References
    ----------
    Van Loan (1978), *Computing integrals involving the matrix exponential*, IEEE Transactions on
    Automatic Control 23(3), theorem 1.
    """
    from scipy.linalg import expm

    # The block exponential contains exp(-A T), which overflows for a stable A with fast
    # modes. The first interval is so short that the norm of A times its length is <= 1.
    doublings = max(0, ceil(log2(max(float(np.linalg.norm(A, 1)) * time, 1.0))))
    n = len(A)
    flow = expm(
        np.block([[-A, density], [np.zeros((n, n)), A.T]]) * (time / 2**doublings)
    )
    # The blocks of the second column are exp(A T)^-1 Q_k and exp(A T)^T.
    turned = flow[n:, n:].T
    added = turned @ flow[:n, n:]
    for _ in range(doublings):
        # Q(2T) = exp(A T) Q(T) exp(A T)^T + Q(T): noise of the first half passes
        # through the second half.
        added, turned = turned @ added @ turned.T + added, turned @ turned
    return np.asarray((added + added.T) / 2)


def steady_covariance(
    A: Vector, C: Vector, Q: Vector, R: Vector, names: Sequence[str]
) -> Vector:
    r"""Return the steady-state covariance of the one-sample prediction of a Kalman filter.

    It is the stabilizing solution of

    .. math:: P = A (P - P C^T (C P C^T + R)^{-1} C P) A^T + Q

    Parameters
    ----------
    A, C, Q, R : Vector
        The sampled system, and the covariances of its noise [any].
    names : sequence of str
        Names of its states.

    Raises
    ------
    LinearAnalysisError
        If no noise drives a state that does not decay, or the Riccati equation has no solution.

    References
    ----------
    Anderson, Moore (1979), *Optimal Filtering*, section 4.4.
    """
    from scipy.linalg import solve_discrete_are

    # Duality: the modes of A that Q does not drive are unobservable in (A^T, Q).
    # Without noise in a mode on the unit circle there is no stabilizing solution.
    if still := hidden(A.T, Q, names):
        raise LinearAnalysisError(
            f"no process noise drives {still}, which do not decay: a steady filter would ignore their "
            "measurements; give them noise, a disturbance a density above 0, or take kind='varying'"
        )
    # Scale measurements by their noise and states by one unit, so that both terms of P have similar size.
    seen = np.linalg.solve(np.linalg.cholesky(R), C)
    noise, shown = float(np.linalg.norm(Q)), float(np.linalg.norm(seen))
    # In x = unit * x', Q becomes Q / unit^2 and C^T R^-1 C becomes unit^2 C^T R^-1 C.
    # They are equal for unit^4 = |Q| / |C|^2. Without noise any unit does, here 1.
    unit = (noise / max(shown**2, 1e-99)) ** 0.25 or 1.0
    try:
        # SciPy solves the equation of the regulator; the filter is its dual: A^T, C^T.
        P = unit**2 * solve_discrete_are(
            A.T, unit * seen.T, Q / unit**2, np.eye(len(R))
        )
    except (np.linalg.LinAlgError, ValueError) as error:
        raise LinearAnalysisError(
            f"cannot solve the Riccati equation of the Kalman filter: {error}; the noises, or the units of "
            "the states, may differ too much in size"
        ) from None
    return np.asarray((P + P.T) / 2)


def refuse_undetectable(A: Vector, C: Vector, names: Sequence[str]) -> None:
    """Raise `LinearAnalysisError` for states that neither decay nor are observable.

    Parameters
    ----------
    A, C : Vector
        The sampled system [any].
    names : sequence of str
        Names of its states.

    Raises
    ------
    LinearAnalysisError
        If there is such a state; the message names it.
    """
    if unseen := hidden(A, C, names):
        raise LinearAnalysisError(
            f"cannot estimate {unseen}, which do not decay: the measurements do not depend on them, or cannot "
            "distinguish them; measure more signals, or leave them out of the model"
        )


def hidden(
    A: Vector, C: Vector, names: Sequence[str], slowest: float = 1.0 - ROUND_OFF
) -> str:
    """Return the names of the states in the unobservable modes of (A, C) that decay no faster than given.

    The unobservable subspace is the largest A-invariant subspace of the null space of C. It is found by
    repeated restriction, which, unlike eigenvectors, is well conditioned for repeated rigid-body modes.

    Parameters
    ----------
    A, C : Vector
        Matrices of a sampled system [any].
    names : sequence of str
        Names of the states.
    slowest : float
        Smallest modulus of an eigenvalue that counts as not decaying [-].
    """
    from scipy.linalg import matrix_balance, schur

    # Balance the couplings. Chains of integrators have no return path; a small coupling provides one. It limits
    # the change of units to about 100 for each step of a chain, so that round-off is not balanced, too.
    couplings = np.abs(A - np.eye(len(A)))
    _, (units, _) = matrix_balance(
        couplings + 1e-4 * couplings.max(), permute=False, separate=True
    )
    # For short samples A is almost the identity. The difference has the same invariant
    # subspaces, and its couplings are not small beside ones on the diagonal.
    rates, C = (A - np.eye(len(A))) * units / units[:, None], C * units
    # Each measurement counts relative to its own size; rows of zeros stay zero.
    largest = np.linalg.norm(C, axis=1, keepdims=True)
    basis = _null_space(C / np.where(largest > 0, largest, 1.0), 1.0)
    size = -1
    while size != basis.shape[1]:
        size = basis.shape[1]
        # The part of the rates that leaves the subspace; only directions in which it is
        # zero stay. The dimension never grows, so that the loop ends.
        outside = rates @ basis - basis @ (basis.T @ rates @ basis)
        basis = basis @ _null_space(outside, float(np.linalg.norm(rates)))
    if not size:
        return ""
    within = np.eye(size) + basis.T @ rates @ basis
    # The stubs know no sorting by one complex number.
    _, modes, number = schur(within, "complex", sort=lambda z: abs(z) >= slowest)  # type: ignore[call-overload]
    # The first Schur vectors span the modes that do not decay. The norm of a row is the
    # participation of a state; below 1 % it is not worth a name in the message.
    share = np.linalg.norm(basis @ modes[:, :number], axis=1)
    return ", ".join(
        f"'{name}'" for name, s in zip(names, share, strict=True) if s > 0.01
    )


def _null_space(matrix: Vector, largest: float) -> Vector:
    """Return an orthonormal basis of the null space of a matrix whose largest singular value is `largest`."""
    _, values, rows = np.linalg.svd(matrix)
    # The number of nonzero singular values is the rank. `rows` is square, also for a
    # flat matrix, so that the rows after the rank span the null space.
    return np.asarray(rows[np.sum(values > ROUND_OFF * largest) :].T)
