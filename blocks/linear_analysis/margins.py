r"""Stability margins from loop gains: channel by channel, and of many channels at once.

A channel's loop gain with all other channels closed follows from the sensitivity at it,

.. math:: L_k = 1 / [(I + L)^{-1}]_{kk} - 1.

Gain, phase and delay margins are python-control's, of :math:`L_k`; so are disk margins, balanced
(skew 0). A multi-loop disk margin allows gain and phase to change in all channels of a group,
independently and at the same time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.support.call_site import warn
from trussflow.blocks.support.types import Vector

if TYPE_CHECKING:
    import control

Complex = NDArray[np.complex128]

REFINED_SHARE = 1.1
"""Minima of the disk margin on the grid up to this multiple of the least one are refined [-]."""

FREQUENCY_TOLERANCE = 1e-10
"""Relative tolerance of the frequency at which a disk margin is least [-]."""

ZERO_GAIN = 1e-9
"""Loop gain below which the loop counts as open [-]."""

HIDDEN_SHARE = 1e-9
"""Effect of the inputs on a mode, or of the mode on the outputs, relative to the norm of B or C, up to which
the mode counts as hidden [-]."""

SUM_ROUND_OFF = 10.0 * float(np.finfo(float).eps)
"""Relative error of each of the n sums that make an element of a state matrix [-]."""

MAX_CONDITION = 1e8
"""Condition of the eigenvectors up to which a frequency response is computed from the modes [-]."""

LOW_FREQUENCY_RATIO = 1e-6
"""Frequency that represents zero, relative to the slowest pole [-], because integrators have no response at
zero; the error of the real part is its square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Margins of one channel, all others closed; the defaults are those of an open loop.

    Attributes
    ----------
    crossover : float
        Highest frequency of gain one [rad/s]; nan if there is none.
    gain_down, gain_up : float
        Factors on the gain at the limit of stability, below and above one [1]; 0 and inf if
        there is no limit.
    phase : float
        Smallest phase margin [deg].
    delay : float
        Smallest delay at the limit of stability [s].
    disk : float
        Disk margin [1].
    """

    crossover: float = np.nan
    gain_down: float = 0.0
    gain_up: float = np.inf
    phase: float = np.inf
    delay: float = np.inf
    disk: float = 2.0


def frequencies_about(
    poles: Complex, low: float = 1e-2, high: float = 1e4, points: int = 600
) -> Vector:
    """Return a frequency grid: uniform in logarithm, and dense around each resonance.

    Parameters
    ----------
    poles : array
        Poles of the open and the closed loop; for a sampled loop log(pole) / period [1/s].
    low, high : float
        Ends [rad/s].
    points : int
        Evenly in logarithm [-].
    """
    sizes = np.abs(poles)
    # Damping ratios below 0.3, one pole of each pair. The even grid shows other poles.
    sharp = (poles.imag > low) & (np.abs(poles.real) < 0.3 * sizes) & (sizes < high)
    # Dense in the middle: a resonance is as narrow as its pole is near the axis.
    spread = np.sinh(np.linspace(-4.0, 4.0, 17)) / np.sinh(4.0)
    near = [
        # 30 half-widths |s| to each side, with a damping ratio of at least 1e-4.
        w + spread * np.minimum(0.3 * w, 30 * max(abs(s), 1e-4 * w))
        for s, w in zip(poles.real[sharp], poles.imag[sharp], strict=True)
    ]
    found = np.unique(np.concatenate([np.geomspace(low, high, points), *near]))
    # Neighbours equal up to round-off would make interpolation divide by almost zero.
    keep = np.concatenate([[True], np.diff(found) > 1e-9 * found[1:]])
    return found[keep & (found >= low) & (found <= high)]


def response(model: control.StateSpace, omega: Vector) -> Complex:
    """Return the frequency response, of shape (frequencies, outputs, inputs).

    Parameters
    ----------
    model : control.StateSpace
        Any, continuous or sampled.
    omega : array, shape (k,)
        Frequencies [rad/s].
    """
    return np.asarray(
        np.moveaxis(model(on_the_border(model, omega), squeeze=False), 2, 0)
    )


def sensitivities(model: control.StateSpace, omega: Vector) -> Complex:
    """Return the sensitivity (I + L)^-1 of a loop gain L, of shape (frequencies, channels, channels) [-].

    It follows from the closed loop, so it is finite where L is infinite.

    Parameters
    ----------
    model : control.StateSpace
        L, square.
    omega : array, shape (k,)
        Frequencies [rad/s].
    """
    import control  # takes a while to import

    return response(control.ss(*sensitivity_matrices(model), model.dt), omega)


def channel_responses(sensitivity: Complex) -> Complex:
    """Return the loop gain of each channel with the others closed, of shape (frequencies, channels) [-].

    It is infinite where the sensitivity of a channel is 0, as at the poles of L on the imaginary axis.

    Parameters
    ----------
    sensitivity : array
        From `sensitivities`.
    """
    S = np.einsum("kii->ki", sensitivity)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(S == 0.0, np.inf, 1.0 / S - 1.0))


def sensitivity_matrices(
    model: control.StateSpace,
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return A, B, C and D of the sensitivity function (I + L)^-1 of a loop gain L.

    Parameters
    ----------
    model : control.StateSpace
        L, square.
    """
    # The error e = r - C x - D e is (I + D)^-1 (r - C x); it drives x' = A x + B e.
    left = np.linalg.inv(np.eye(model.ninputs) + model.D)
    return model.A - model.B @ left @ model.C, model.B @ left, -left @ model.C, left


def stable_poles(model: control.StateSpace, loop: str) -> Complex:
    r"""Return the poles of a closed loop, which must be stable.

    Parameters
    ----------
    model : control.StateSpace
        Loop gain, square.
    loop : str
        Name of the loop for messages.

    Raises
    ------
    LinearAnalysisError
        If the closed loop is unstable: it has no margins. The message lists the unstable poles.

    Warns
    -----
    SimulationWarning
        If the diagram has unstable poles that are not controllable or not observable at the wire.

    Notes
    -----
    Round-off moves a pole by up to :math:`n \epsilon \|A\| / |l^H r|`, with the left and right eigenvectors l
    and r of length one. This bound separates unstable poles from integrals, also from chains of integrals.
    """
    from scipy.linalg import eig, matrix_balance

    A, B, C, _ = sensitivity_matrices(model)
    # Balancing reduces |A|, and with it the bound on round-off. States are divided by
    # `scale`, so that B and C must follow.
    balanced: Any = matrix_balance(A, permute=False, separate=True)
    A, (scale, _) = balanced
    found: Any = eig(A, left=True, right=True)
    poles, lefts, rights = found
    sampled = model.isdtime(strict=True)
    # The bound of the Notes is multiplied by |l^H r|, which is zero for multiple poles.
    growth = np.abs(poles) - 1.0 if sampled else poles.real
    overlap = np.abs(np.sum(lefts.conj() * rights, axis=0))
    unstable = growth * overlap > SUM_ROUND_OFF * len(A) * np.linalg.norm(A)
    B, C = B / scale[:, None], C * scale
    # A mode that the inputs do not drive, or the outputs do not show, cancels in L: no
    # gain can stabilize or destabilize it.
    excited = np.linalg.norm(
        lefts.conj().T @ B, axis=1
    ) > HIDDEN_SHARE * np.linalg.norm(B)
    seen = np.linalg.norm(C @ rights, axis=0) > HIDDEN_SHARE * np.linalg.norm(C)

    def listed(of: NDArray[np.bool_]) -> str:
        return ", ".join(
            f"{pole if pole.imag else pole.real:.4g}" for pole in poles[unstable & of]
        )

    if named := listed(excited & seen):
        raise LinearAnalysisError(
            f"the loop at '{loop}' has no margins: closed, it has the unstable poles {named}"
        )
    if named := listed(~(excited & seen)):
        warn(
            f"the loop at '{loop}' hides the unstable poles {named} of the diagram: its margins are "
            "those of the other poles; stabilize the diagram, or open the loop at another wire"
        )
    return np.asarray(poles)


def real_sensitivities(model: control.StateSpace, slowest: float) -> Vector:
    """Return the sensitivity of each channel at the ends of the border of stability, of shape (2, m) [-].

    It is real there. It is computed from the closed loop, because integrators make the loop gain unbounded.

    Parameters
    ----------
    model : control.StateSpace
        Loop gain, continuous (at the frequencies 0 and infinity) or sampled (0 and half the sampling rate).
    slowest : float
        Modulus of the slowest pole, or the lowest frequency of interest [rad/s].
    """
    A, B, C, D = sensitivity_matrices(model)

    def at(z: complex) -> Complex:
        return np.diagonal(D + C @ np.linalg.solve(z * np.eye(len(A)) - A, B))

    (first,) = on_the_border(model, np.array([LOW_FREQUENCY_RATIO * slowest]))
    return np.real(
        [at(first), at(-1.0) if model.isdtime(strict=True) else np.diagonal(D)]
    )


def channel_margins(gain: Complex, omega: Vector, ends: Vector, disk: float) -> Margins:
    """Return the margins of one channel of a stable loop.

    Parameters
    ----------
    gain : array, shape (k,)
        Loop gain for negative feedback; infinite values are left out [-].
    omega : array, shape (k,)
        Frequencies, close enough for interpolation [rad/s].
    ends : array
        Sensitivity at the ends of the border of stability, where a pole leaves it along the real axis [-].
    disk : float
        Its disk margin [1].
    """
    import control  # takes a while to import

    finite = np.isfinite(gain)
    gain = gain[finite]
    omega = omega[finite]
    if np.abs(gain).max(initial=0.0) < ZERO_GAIN:  # nothing comes back
        return Margins()
    data = control.FrequencyResponseData(gain, omega, smooth=True)
    gm, pm, _, _, crossings, _ = control.stability_margins(data, returnall=True)
    gm, pm, crossings = (np.asarray(v, dtype=float) for v in (gm, pm, crossings))
    # At frequency 0, at infinity or at half the sampling rate, L = 1 / S - 1 is real
    # and 1 + k L = 0 at k = S / (S - 1), which is a positive factor for S < 0 and S >
    # 1. The crossings of the grid do not contain these ends.
    S = ends[(ends < -ZERO_GAIN) | (ends > 1.0 + ZERO_GAIN)]
    gm = np.concatenate([gm, S / (S - 1.0)])
    # A delay only reduces the phase: a margin of -30° is reached after 330°.
    lags = np.radians(np.mod(pm, 360.0)) / crossings
    return Margins(
        crossover=float(crossings.max()) if crossings.size else np.nan,
        gain_down=float(gm[gm < 1].max(initial=0.0)),
        gain_up=float(gm[gm > 1].min(initial=np.inf)),
        phase=float(np.abs(pm).min(initial=np.inf)),
        delay=float(lags.min(initial=np.inf)),
        disk=disk,
    )


def _least(
    margin: Callable[[float], float], values: Vector, omega: Vector
) -> tuple[float, float]:
    """Return the least value of a margin, and its frequency: all low minima of the grid are refined.

    Parameters
    ----------
    margin : callable
        The margin at a frequency [1].
    values : array, shape (k,)
        The margin on the grid, infinite where it is not needed [1].
    omega : array, shape (k,)
        The grid [rad/s].
    """
    from scipy.optimize import minimize_scalar

    # Ends of the grid may be minima. `<` on one side and `<=` on the other count a
    # plateau once, at its first point.
    padded = np.concatenate([[np.inf], values, [np.inf]])
    minima = (
        (values < padded[:-2])
        & (values <= padded[2:])
        & (values <= REFINED_SHARE * values.min())
    )
    best = float(values.min()), float(omega[values.argmin()])
    for k in np.flatnonzero(minima).tolist():
        low, high = omega[max(k - 1, 0)], omega[min(k + 1, len(omega) - 1)]
        if low < high:
            settings: dict[str, Any] = {
                "bounds": (low, high),
                "options": {"xatol": FREQUENCY_TOLERANCE * high},
            }
            found = minimize_scalar(margin, method="bounded", **settings)
            best = min(best, (float(found.fun), float(found.x)))
    return best


def disk_margin(
    model: control.StateSpace, omega: Vector, sensitivity: Complex
) -> tuple[float, float, float, float]:
    r"""Return the multi-loop disk margin of a group of channels.

    Parameters
    ----------
    model : control.StateSpace
        Loop gain of the group for negative feedback, all other channels closed; stable when closed.
    omega : array, shape (k,)
        Ascending frequencies, close enough to separate the minima of the margin [rad/s].
    sensitivity : array
        The `sensitivities` of `model` at `omega`.

    Returns
    -------
    float, float, float, float
        Disk margin [1], the gain and phase margins that it guarantees in all channels at once
        [dB, deg], and the frequency of the least margin [rad/s].

    Raises
    ------
    LinearAnalysisError
        If there are several channels, and slycot is not installed.

    Notes
    -----
    The margin at a frequency is at least :math:`1/\rho(|S - I/2|)`, with the Perron root of
    the absolute values. It is computed by python-control where that bound allows a minimum, and the minima
    on the grid are refined between their neighbours.
    """
    import control  # takes a while to import

    # A structured singular value at each frequency is expensive. The cheap bound
    # excludes most of the grid.
    deviations = np.abs(sensitivity - np.eye(model.ninputs) / 2)
    bounds = 1.0 / np.abs(np.linalg.eigvals(deviations)).max(axis=1)

    def margin(frequencies: Vector) -> Vector:
        try:
            return np.asarray(
                control.disk_margins(model, frequencies, returnall=True)[0]
            )
        except control.ControlMIMONotImplemented:
            raise LinearAnalysisError(
                f"the disk margin of {model.ninputs} channels at once needs slycot: pip install "
                "'trussflow[margins]', or name one element of the port"
            ) from None

    margins = np.full(len(omega), np.inf)
    order = np.argsort(bounds)
    # The margin at the least bound is no less than the minimum sought, so that
    # frequencies with a greater bound cannot contain it.
    limit = REFINED_SHARE * margin(omega[order[:1]])[0]
    near = np.sort(order[: np.searchsorted(bounds[order], limit)])
    margins[near] = margin(omega[near])
    _, best = _least(lambda w: float(margin(np.array([w]))[0]), margins, omega)
    disk, gain, phase = (
        float(value) for value in control.disk_margins(model, np.array([best]))
    )
    return disk, gain, phase, best


def channel_disks(model: control.StateSpace, omega: Vector) -> tuple[Vector, Vector]:
    r"""Return the disk margin of each channel, all others closed, and where it is least [1, rad/s].

    .. math:: S_{kk}(z) = D_{kk} + \sum_i \frac{(C r_i)_k (l_i^T B)_k}{z - \lambda_i}

    Parameters
    ----------
    model : control.StateSpace
        Loop gain of all channels for negative feedback; stable when closed.
    omega : array, shape (k,)
        Ascending frequencies, close enough to separate the minima of the margins [rad/s].
    """
    A, B, C, D = sensitivity_matrices(model)
    poles, shapes = np.linalg.eig(A)
    if modal := np.linalg.cond(shapes) < MAX_CONDITION:
        # Row i has the residues of pole i in all channels. A frequency then costs n
        # products per channel instead of the solution of n equations.
        residues = (C @ shapes).T * np.linalg.solve(shapes, B)

    def disks(frequencies: Vector) -> Vector:
        if modal:
            where = on_the_border(model, frequencies)
            S = np.diagonal(D) + (1.0 / (where[:, None] - poles)) @ residues
        else:  # poles of several states have no basis of eigenvectors
            S = np.einsum("kii->ki", sensitivities(model, frequencies))
        return np.asarray(1.0 / np.abs(S - 0.5))

    def least(channel: int, values: Vector) -> tuple[float, float]:
        return _least(lambda w: float(disks(np.array([w]))[0, channel]), values, omega)

    found = np.array([least(k, values) for k, values in enumerate(disks(omega).T)])
    return found[:, 0], found[:, 1]


def on_the_border(model: control.StateSpace, omega: Vector) -> Complex:
    """Return where frequencies are on the border of stability: the axis, or the circle.

    Parameters
    ----------
    model : control.StateSpace
        Any, continuous or sampled.
    omega : array
        Frequencies [rad/s].
    """
    return np.asarray(
        np.exp(1j * omega * model.dt) if model.isdtime(strict=True) else 1j * omega
    )
