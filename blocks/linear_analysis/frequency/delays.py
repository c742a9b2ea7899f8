r"""Delay margin and largest sample time of a loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.linear_analysis.lifting import held_flow
from trussflow.blocks.linear_analysis.margins import stable_poles
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import (
    finite_array,
    frequencies,
    is_whole,
    shown,
)

if TYPE_CHECKING:
    import control

GRID_POINTS = 4000
"""Number of frequencies at which the eigenvalues of the loop gain are computed [-]."""


def delay_margin(
    loop: control.StateSpace, *, omega: Sequence[float] | Vector | None = None
) -> tuple[float, float]:
    r"""Return the largest delay, the same in all channels, that a closed loop stands.

    With a delay T in every broken channel the loop is on the stability limit where an
    eigenvalue of the loop gain meets -1,

    .. math:: \lambda_i(L(j \omega))\, e^{-j \omega T} = -1,

    so only where :math:`|\lambda_i| = 1`, at the smallest positive T of all those.

    Parameters
    ----------
    loop : control.StateSpace
        Loop transfer function for negative feedback, as from `loop_transfer`; the loop closed
        without delay must be stable.
    omega : array_like, optional
        Frequencies to search [rad/s]; by default from the loop's poles.

    Returns
    -------
    float, float
        The delay margin [s] and the frequency of the oscillation there [rad/s]; infinite and
        nan if no delay makes the loop unstable, zero and infinite if any does, since a direct
        feedthrough has a gain of one or more at all high frequencies.

    Raises
    ------
    LinearAnalysisError
        If the closed loop is not stable, the model is discrete or not square, or frequencies to search are
        fewer than two or not positive.

    Warns
    -----
    SimulationWarning
        If the diagram has unstable poles that the loop hides: its margins are those of the other poles.
    """
    from scipy.optimize import brentq

    _check_continuous(loop=loop)
    if loop.ninputs != loop.noutputs:
        raise LinearAnalysisError(
            f"a loop has as many outputs as inputs, not {loop.noutputs} and {loop.ninputs}"
        )
    A, B, C, D = (np.asarray(m) for m in (loop.A, loop.B, loop.C, loop.D))
    closed_poles = stable_poles(loop, loop.input_labels[0])
    if np.abs(np.linalg.eigvals(D)).max(initial=0.0) >= 1:
        return 0.0, np.inf
    poles = np.concatenate([np.linalg.eigvals(A), closed_poles])
    grid = _grid(poles) if omega is None else np.sort(frequencies(omega, 2))

    def gains(w: float) -> NDArray[np.complex128]:
        gain = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
        return np.asarray(np.linalg.eigvals(gain))

    def sizes_at(w: float) -> Vector:
        return np.asarray(np.sort(np.log(np.abs(gains(w)) + 1e-300)))

    found = [(np.inf, np.nan)]
    values = np.array([sizes_at(w) for w in grid])
    for k, i in np.argwhere(np.diff(np.sign(values), axis=0) != 0):
        crossing = brentq(
            lambda w, i: float(sizes_at(w)[i]),
            grid[k],
            grid[k + 1],
            args=(i,),
            xtol=1e-12 * grid[k],
        )
        for gain in gains(crossing):
            if abs(abs(gain) - 1) < 1e-6:  # two gains may cross here together
                turn = (np.angle(gain) + np.pi) % (2 * np.pi)
                turn = 0.0 if turn > 2 * np.pi - 1e-9 else turn  # a gain of -1, rounded
                found.append((float(turn / crossing), float(crossing)))
    return min(found, key=lambda pair: pair[0])


def _check_continuous(**models: Any) -> None:
    """Refuse what is no continuous linear model.

    Raises
    ------
    LinearAnalysisError
        Naming it.
    """
    import control

    for name, model in models.items():
        if not isinstance(model, control.StateSpace) or not model.isctime():
            raise LinearAnalysisError(
                f"the {name} must be a continuous model, a control.StateSpace, not {shown(model)}"
            )


def _grid(poles: NDArray[np.complex128]) -> Vector:
    """Return frequencies to search: evenly in logarithm, and close around lightly damped poles."""
    sizes = np.abs(poles)
    sizes = sizes[sizes > 1e-6 * max(sizes.max(initial=0.0), 1e-12)]
    low, high = (sizes.min() / 30, sizes.max() * 30) if sizes.size else (1e-3, 1e3)
    peaks = np.unique(np.abs(poles.imag[np.abs(poles.imag) > low]))
    around = np.geomspace(1e-9, 1e-2, 22)
    around = 1 + np.concatenate([-around, around])
    return np.unique(
        [*np.geomspace(low, high, GRID_POINTS), *np.outer(peaks, around).ravel()]
    )


def largest_sample_time(
    plant: control.StateSpace,
    controller: control.StateSpace,
    *,
    delay: float = 0.0,
    shortest: float = 1e-4,
    longest: float = 10.0,
    points: int = 120,
) -> float:
    r"""Return the longest control period up to which a sampled loop is stable.

    The controller measures at the start of each period, its own linear equations are
    discretized for held measurements (exactly), and its command is held for a period, after
    a computing time of `delay` periods. The plant moves on exactly in between.

    Parameters
    ----------
    plant : control.StateSpace
        From command to measurement, without direct feedthrough.
    controller : control.StateSpace
        From measurement to command, its sign included: the loop is closed by adding.
    delay : float
        Computing time, from 0 to 1 periods [-].
    shortest, longest : float
        Range of the search [s].
    points : int
        Periods looked at on the way up, evenly in logarithm [-].

    Returns
    -------
    float
        The first limit of stability on the way up [s], to 0.1 %; 0 if already the shortest
        period is unstable, infinite if none of the periods looked at is.

    Raises
    ------
    LinearAnalysisError
        If the plant has direct feedthrough, the models do not fit each other or are not
        continuous, or an argument makes no sense.
    """
    _check_continuous(plant=plant, controller=controller)
    for name, value in {
        "shortest": shortest,
        "longest": longest,
        "delay": delay,
    }.items():
        finite_array(name, value, ())
    if np.any(np.asarray(plant.D) != 0):
        raise LinearAnalysisError(
            "a plant with direct feedthrough has an algebraic loop when held"
        )
    if (plant.ninputs, plant.noutputs) != (controller.noutputs, controller.ninputs):
        raise LinearAnalysisError(
            f"a plant with {plant.ninputs} inputs and {plant.noutputs} outputs does not fit a "
            f"controller with {controller.ninputs} inputs and {controller.noutputs} outputs"
        )
    if not (
        0 < shortest < longest < np.inf and is_whole(points) and 1 < points <= 1_000_000
    ):
        raise LinearAnalysisError(
            f"shortest = {shortest}, longest = {longest}, points = {points}: the periods must rise "
            "from above zero, with two to a million points"
        )
    if not 0 <= delay <= 1:
        raise LinearAnalysisError(f"delay = {delay} must be from 0 to 1 periods")

    def stable(period: float) -> bool:
        return sampled_loop_radius(plant, controller, period, delay) <= 1 + 1e-9

    periods = np.geomspace(shortest, longest, points)
    if not stable(periods[0]):
        return 0.0
    for before, after in pairwise(periods):
        if not stable(after):
            return _limit(stable, float(before), float(after))
    return float("inf")


def _limit(stable: Callable[[float], bool], low: float, high: float) -> float:
    while high > low * 1.001:
        middle = (low * high) ** 0.5
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def sampled_loop_radius(
    plant: control.StateSpace,
    controller: control.StateSpace,
    period: float,
    delay: float,
) -> float:
    """Return the spectral radius of the loop that `largest_sample_time` describes.

    Parameters
    ----------
    plant, controller : control.StateSpace
        As there.
    period : float
        Control period [s].
    delay : float
        Computing time in periods [-].
    """
    A, B, C = (np.asarray(m) for m in (plant.A, plant.B, plant.C))
    K, L, M, N = (
        np.asarray(m) for m in (controller.A, controller.B, controller.C, controller.D)
    )
    first, early = held_flow(A, B, delay * period)  # the old command still acts
    second, late = held_flow(A, B, (1 - delay) * period)
    turned, driven = held_flow(K, L, period)
    # x, controller state, command of the period before; the new command is M c + N C x
    step = np.block(
        [
            [second @ first + late @ N @ C, late @ M, second @ early],
            [driven @ C, turned, np.zeros((len(K), len(M)))],
            [N @ C, M, np.zeros((len(M), len(M)))],
        ]
    )
    return float(np.abs(np.linalg.eigvals(step)).max(initial=0.0))
