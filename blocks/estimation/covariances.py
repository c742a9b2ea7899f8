"""Covariances: checked, sampled, and the steady one of a Kalman filter."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log2

import numpy as np
import numpy.typing as npt

from trussflow.blocks.estimation.processes import LinearProcess
from trussflow.blocks.framework.errors import LinearAnalysisError, ParameterError
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import finite_array

ROUND_OFF = 1e-10
"""What counts as zero, relative to the largest: of asymmetry, of eigenvalues, of couplings of states."""


def covariance(what: str, value: npt.ArrayLike, size: int, *, definite: bool = False) -> Vector:
    """Return a covariance matrix, checked.

    Parameters
    ----------
    what : str
        What it is, for messages.
    value : array_like
        A matrix, its diagonal, or one number for all of the diagonal [any].
    size : int
        How many rows it must have [-].
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
    round_off = ROUND_OFF * np.abs(matrix).max(initial=0.0)
    if (np.abs(matrix - matrix.T) > round_off).any():
        raise ParameterError(f"{what} is not symmetric: a covariance is")
    # In units of each diagonal element, so that metres do not hide nanometres.
    scale = np.sqrt(np.where(np.diag(matrix) > 0, np.diag(matrix), 1.0))
    smallest = np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min(initial=1.0)
    if smallest < (ROUND_OFF if definite else -ROUND_OFF):
        raise ParameterError(
            f"{what} is not positive {'' if definite else 'semi'}definite: it must be"
            + (", as a measurement without noise leaves nothing to estimate" if definite else "")
        )
    return (matrix + matrix.T) / 2


def sampled_covariance(A: Vector, density: Vector, time: float) -> Vector:
    r"""Return the covariance of what white noise adds to a linear system within a time.

    .. math:: Q_k = \int_0^T e^{A s} Q e^{A^T s} ds

    of one exponential of a matrix, over a time so short that nothing is lost in it, and doubled from there.

    Parameters
    ----------
    A, density : Vector
        System matrix, and the noise's power spectral density Q in its rates [1/s, any].
    time : float
        T [s].

    References
    ----------
    Van Loan (1978), *Computing integrals involving the matrix exponential*, IEEE Transactions on Automatic
    Control 23(3), theorem 1.
    """
    from scipy.linalg import expm

    doublings = max(0, ceil(log2(max(np.linalg.norm(A, 1) * time, 1.0))))
    n = len(A)
    flow = expm(np.block([[-A, density], [np.zeros((n, n)), A.T]]) * (time / 2**doublings))
    turned = flow[n:, n:].T
    added = turned @ flow[:n, n:]
    for _ in range(doublings):
        added, turned = turned @ added @ turned.T + added, turned @ turned
    return np.asarray((added + added.T) / 2)


def steady_covariance(process: LinearProcess, names: Sequence[str], *, allow_unobserved: bool) -> Vector:
    r"""Return the covariance of the state, predicted by one sample, that a filter comes to.

    It is the stabilizing solution of

    .. math:: P = \Phi (P - P C^T (C P C^T + R)^{-1} C P) \Phi^T + Q

    Parameters
    ----------
    process : LinearProcess
        The process.
    names : sequence of str
        Names of its states.
    allow_unobserved : bool
        Whether states that no measurement shows may be left to the model, if they decay.

    Raises
    ------
    LinearAnalysisError
        If measurements do not show a state, or nothing drives one that does not decay.

    References
    ----------
    Anderson, Moore (1979), *Optimal Filtering*, section 4.4.
    """
    from scipy.linalg import solve_discrete_are

    refuse_unobserved(process, names, allow_decaying=allow_unobserved)
    still = hidden(process.A.T, process.covariance, names, slowest=1.0 - ROUND_OFF)
    if still:
        raise LinearAnalysisError(
            f"no process noise drives {still}, which do not decay: a steady filter would stop looking at the "
            "measurements; name them in process_noise, give a disturbance a density above 0, or take "
            "kind='varying'"
        )
    try:
        P = solve_discrete_are(process.A.T, process.C.T, process.covariance, process.noise)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise LinearAnalysisError(
            f"the Riccati equation of the Kalman filter has no solution that can be found: {error}; noise may "
            "be too small against the measurements', or states in units of very different size"
        ) from None
    return np.asarray((P + P.T) / 2)


def refuse_unobserved(process: LinearProcess, names: Sequence[str], *, allow_decaying: bool) -> None:
    """Refuse a process with states that its measurements do not show.

    Parameters
    ----------
    process : LinearProcess
        The process.
    names : sequence of str
        Names of its states.
    allow_decaying : bool
        Whether such states are allowed if they decay by themselves.

    Raises
    ------
    LinearAnalysisError
        If there are such states; the message names them.
    """
    unseen = hidden(process.A, process.C, names, slowest=1.0 - ROUND_OFF if allow_decaying else 0.0)
    if unseen:
        raise LinearAnalysisError(
            f"cannot estimate {unseen}: what is measured never shows them, or not apart from each other; "
            "measure more, or leave them out of the model"
            + ("" if allow_decaying else " (allow_unobserved=True leaves those that decay to the model)")
        )


def hidden(A: Vector, C: Vector, names: Sequence[str], slowest: float) -> str:
    """Return the names of the states in the unobservable modes of (A, C) that decay no faster than given.

    The unobservable subspace is made smaller step by step: first all that C does not see, then that part of it
    which A leaves in it. Unlike eigenvectors, that needs no care where modes coincide, as rigid ones do.

    Parameters
    ----------
    A, C : Vector
        Matrices of a sampled system [any].
    names : sequence of str
        Names of the states.
    slowest : float
        Factor by which such a mode shrinks in each sample, at least [1].
    """
    from scipy.linalg import matrix_balance

    _, (scale, _) = matrix_balance(A - np.eye(len(A)), permute=False, separate=True)
    rates = (A - np.eye(len(A))) * scale / scale[:, None]
    rows = np.linalg.norm(C * scale, axis=1, keepdims=True)
    basis = _null_space(C * scale / np.where(rows > 0, rows, 1.0), 1.0)
    size, now = -1, basis.shape[1]
    while size != now:
        outside = rates @ basis - basis @ (basis.T @ rates @ basis)
        basis = basis @ _null_space(outside, float(np.linalg.norm(rates)))
        size, now = now, basis.shape[1]
    factors, modes = np.linalg.eig(np.eye(now) + basis.T @ rates @ basis)
    share = np.linalg.norm(basis @ modes[:, np.abs(factors) >= slowest], axis=1)
    return ", ".join(
        f"'{n}'" for n, s in zip(names, share, strict=True) if s > 0.01 * share.max(initial=1e-300)
    )


def _null_space(matrix: Vector, largest: float) -> Vector:
    """Return an orthonormal basis of what a matrix maps to zero, to round-off of the largest there may be."""
    _, values, rows = np.linalg.svd(matrix)
    rank = int(np.sum(values > ROUND_OFF * largest))
    return np.asarray(rows[rank:].T)
