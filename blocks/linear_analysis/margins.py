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
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from trussflow.blocks.framework.errors import LinearAnalysisError
from trussflow.blocks.framework.types import Vector

if TYPE_CHECKING:
    import control

Complex = NDArray[np.complex128]

REFINED_SHARE = 1.1
"""Minima of the disk margin on the grid up to this multiple of the least one are refined [-]."""

FREQUENCY_TOLERANCE = 1e-10
"""Relative tolerance of the frequency at which a disk margin is least [-]."""

ZERO_GAIN = 1e-9
"""Loop gain below which the loop counts as open [-]."""

RESIDUE_TOLERANCE = 1e-9
"""Residue of a pole, relative to the largest, that counts as round-off [-]."""

ROUND_OFF = 1e-12
"""Growth rate of a pole, relative to the fastest pole, that is round-off [-]."""

LOW_FREQUENCY_RATIO = 1e-6
"""Frequency that represents zero, relative to the slowest pole [-], because integrators have no response at
zero; the error of the real part is its square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Margins of one channel, all others closed; by default those of a loop that is not there.

    Attributes
    ----------
    channel : str
        Name of the channel.
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

    channel: str
    crossover: float = np.nan
    gain_down: float = 0.0
    gain_up: float = np.inf
    phase: float = np.inf
    delay: float = np.inf
    disk: float = 2.0


def frequencies_about(poles: Complex, low: float = 1e-2, high: float = 1e4, points: int = 600) -> Vector:
    """Return frequencies that show a loop: even in logarithm, and close about each resonance.

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
    sharp = (poles.imag > low) & (np.abs(poles.real) < 0.3 * sizes) & (sizes < high)
    # Dense in the middle: a resonance is as narrow as its pole is near the axis.
    spread = np.sinh(np.linspace(-4.0, 4.0, 17)) / np.sinh(4.0)
    near = [
        w + spread * np.minimum(0.3 * w, 30 * max(abs(s), 1e-4 * w))
        for s, w in zip(poles.real[sharp], poles.imag[sharp], strict=True)
    ]
    found = np.unique(np.concatenate([np.geomspace(low, high, points), *near]))
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
    return np.asarray(np.moveaxis(model(on_the_border(model, omega), squeeze=False), 2, 0))


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


def sensitivity_matrices(model: control.StateSpace) -> tuple[Vector, Vector, Vector, Vector]:
    """Return A, B, C and D of the sensitivity function (I + L)^-1 of a loop gain L.

    Parameters
    ----------
    model : control.StateSpace
        L, square.
    """
    left = np.linalg.inv(np.eye(model.ninputs) + model.D)
    return model.A - model.B @ left @ model.C, model.B @ left, -left @ model.C, left


def stable_poles(model: control.StateSpace, loop: str) -> Complex:
    """Return the poles of a closed loop, which must be stable.

    Parameters
    ----------
    model : control.StateSpace
        Loop gain, square.
    loop : str
        Name of the loop for the message.

    Raises
    ------
    LinearAnalysisError
        If the closed loop is unstable: it has no margins. The message lists the unstable poles.
    """
    A, B, C, _ = sensitivity_matrices(model)
    poles, shapes = np.linalg.eig(A)
    # What is neither excited nor seen at the wire is no pole of the loop, such as an integral of a cost.
    part = np.linalg.norm(C @ shapes, axis=0) * np.linalg.norm(np.linalg.pinv(shapes) @ B, axis=1)
    sizes = np.abs(poles)
    grows = sizes - 1.0 if model.isdtime(strict=True) else poles.real
    seen = part > RESIDUE_TOLERANCE * part.max(initial=0.0)
    unstable = poles[seen & (grows > ROUND_OFF * sizes.max(initial=0.0))]
    if unstable.size:
        raise LinearAnalysisError(
            f"the loop at '{loop}' has no margins: closed, it has the unstable poles "
            f"{', '.join(f'{pole:.4g}' for pole in unstable)}"
        )
    return np.asarray(poles)


def real_sensitivities(model: control.StateSpace, slowest: float) -> Vector:
    """Return the sensitivity of each channel at the ends of the border of stability, of shape (2, m) [-].

    It is real there. It follows from the closed loop, as integrals may make loop gains as large as one likes.

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
    return np.real([at(first), at(-1.0) if model.isdtime(strict=True) else np.diagonal(D)])


def channel_margins(gain: Complex, omega: Vector, channel: str, ends: npt.ArrayLike = ()) -> Margins:
    """Return the margins of one channel of a stable loop.

    Parameters
    ----------
    gain : array, shape (k,)
        Loop gain for negative feedback; infinite values are left out [-].
    omega : array, shape (k,)
        Frequencies, close enough for interpolation [rad/s].
    channel : str
        Its name.
    ends : array_like
        Sensitivity at the ends of the border of stability, where a pole leaves it along the real axis [-].
    """
    import control  # takes a while to import

    finite = np.isfinite(gain)
    gain, omega = gain[finite], omega[finite]
    if np.abs(gain).max(initial=0.0) < ZERO_GAIN:  # nothing comes back
        return Margins(channel=channel)
    data = control.FrequencyResponseData(gain, omega, smooth=True)
    gm, pm, _, _, crossings, _ = control.stability_margins(data, returnall=True)
    gm, pm, crossings = (np.asarray(v, dtype=float) for v in (gm, pm, crossings))
    S = np.asarray(ends)
    S = S[(S < -ZERO_GAIN) | (S > 1.0 + ZERO_GAIN)]
    gm = np.concatenate([gm, S / (S - 1.0)])
    # A delay only takes phase away: a negative margin is reached after the rest of a turn.
    lags = np.radians(np.mod(pm, 360.0)) / crossings

    def disk(w: float) -> float:
        return float(1.0 / np.abs(1.0 / (1.0 + data(1j * w)) - 0.5))

    widest = int(np.abs(1.0 / (1.0 + gain) - 0.5).argmax())
    return Margins(
        channel=channel,
        crossover=float(crossings.max()) if crossings.size else np.nan,
        gain_down=float(gm[gm < 1].max(initial=0.0)),
        gain_up=float(gm[gm > 1].min(initial=np.inf)),
        phase=float(np.abs(pm).min(initial=np.inf)),
        delay=float(lags.min(initial=np.inf)),
        disk=_refined(disk, omega, widest)[0],
    )


def _refined(margin: Callable[[float], float], omega: Vector, k: int) -> tuple[float, float]:
    """Return the least value of a margin between the neighbours of a grid frequency, and its frequency."""
    from scipy.optimize import minimize_scalar

    low, middle, high = omega[[max(k - 1, 0), k, min(k + 1, len(omega) - 1)]].tolist()
    if low == high:
        return margin(middle), middle
    found = minimize_scalar(
        margin, bounds=(low, high), method="bounded", options={"xatol": FREQUENCY_TOLERANCE * high}
    )
    return min((margin(middle), middle), (float(found.fun), float(found.x)))


def disk_margin(
    model: control.StateSpace, omega: Vector, sensitivity: Complex | None = None
) -> tuple[float, float, float, float]:
    r"""Return the multi-loop disk margin of a group of channels.

    Parameters
    ----------
    model : control.StateSpace
        Loop gain of the group for negative feedback, all other channels closed; stable when closed.
    omega : array, shape (k,)
        Ascending frequencies, close enough to separate the minima of the margin [rad/s].
    sensitivity : array, optional
        The `sensitivities` of `model` at `omega`, if they are known.

    Returns
    -------
    float, float, float, float
        Disk margin [1], the gain and phase margins that it guarantees in all channels at once
        [dB, deg], and the frequency of the least margin [rad/s].

    Raises
    ------
    LinearAnalysisError
        If the closed loop is unstable.

    Notes
    -----
    The margin at a frequency is at least :math:`1/\rho(|S - I/2|)`, with the Perron root of
    the absolute values. It is computed by python-control where that bound allows a minimum, and the minima
    on the grid are refined between their neighbours.
    """
    import control  # takes a while to import

    stable_poles(model, model.input_labels[0])
    S = sensitivities(model, omega) if sensitivity is None else sensitivity
    deviations = np.abs(S - np.eye(model.ninputs) / 2)
    bounds = 1.0 / np.abs(np.linalg.eigvals(deviations)).max(axis=1)

    def margin(frequencies: Vector) -> Vector:
        return np.asarray(control.disk_margins(model, frequencies, returnall=True)[0])

    margins = np.full(len(omega), np.inf)
    order = np.argsort(bounds)
    limit = REFINED_SHARE * margin(omega[order[:1]])[0]
    near = np.sort(order[: np.searchsorted(bounds[order], limit)])
    margins[near] = margin(omega[near])
    best = omega[margins.argmin()]
    padded = np.concatenate([[np.inf], margins, [np.inf]])
    minima = (margins < padded[:-2]) & (margins <= padded[2:]) & (margins <= REFINED_SHARE * margins.min())
    for k in np.flatnonzero(minima).tolist():
        refined, at = _refined(lambda w: float(margin(np.array([w]))[0]), omega, k)
        if refined < margins.min():
            margins[k], best = refined, at
    disk, gain, phase = (float(value) for value in control.disk_margins(model, np.array([best])))
    return disk, gain, phase, float(best)


def channel_disks(model: control.StateSpace, omega: Vector) -> tuple[Vector, Vector]:
    """Return the disk margin of each channel, all others closed, and where it is least [1, rad/s].

    Parameters
    ----------
    model : control.StateSpace
        Loop gain of all channels for negative feedback, without direct feedthrough; stable when closed.
    omega : array, shape (k,)
        Frequencies [rad/s].

    Raises
    ------
    LinearAnalysisError
        If the closed loop is unstable.
    """
    stable_poles(model, model.input_labels[0])
    poles, shapes = np.linalg.eig(model.A - model.B @ model.C)
    residues = (model.C @ shapes).T * np.linalg.solve(shapes, model.B)

    def disks(frequencies: Vector) -> Vector:
        where = on_the_border(model, frequencies)
        sensitivity = 1.0 - (1.0 / (where[:, None] - poles)) @ residues
        return np.asarray(1.0 / np.abs(sensitivity - 0.5))

    def disk(channel: int, frequency: float) -> float:
        return float(disks(np.array([frequency]))[0, channel])

    nearest = disks(omega).argmin(axis=0).tolist()
    least = np.array([_refined(partial(disk, k), omega, at) for k, at in enumerate(nearest)])
    return least[:, 0], least[:, 1]


def on_the_border(model: control.StateSpace, omega: Vector) -> Complex:
    """Return where frequencies are on the border of stability: the axis, or the circle.

    Parameters
    ----------
    model : control.StateSpace
        Any, continuous or sampled.
    omega : array
        Frequencies [rad/s].
    """
    return np.asarray(np.exp(1j * omega * model.dt) if model.isdtime(strict=True) else 1j * omega)
