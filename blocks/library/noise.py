"""Random signals that are reproducible in every run."""

from __future__ import annotations

from math import exp, expm1, prod, sqrt

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import ParameterError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.signals import finite
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import as_shape, finite_array

_M1, _M2 = 4294967087.0, 4294944443.0  # moduli of the two recurrences
_A12, _A13, _A21, _A23 = 1403580.0, 810728.0, 527612.0, 1370589.0  # their multipliers


def _modulo(a: Array, m: float) -> Array:
    """Return a mod m, exactly, for whole numbers a of magnitude below 2^53.

    The quotient is below 2^21, so its rounding error is less than half of 2^-32. A quotient that is not a
    whole number differs from the next one by at least 1/m. So it is never rounded to a whole number.
    """
    return a - np.floor(a / m) * m


def uniform(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Return numbers between 0 and 1, and the next states of the generator.

    The generator is MRG32k3a, a pair of recurrences of third order. All of its integers are exact in
    double precision, so that NumPy and compiled code return the same numbers.

    Parameters
    ----------
    first, second : array, shape (3, n)
        The last three numbers of each recurrence, oldest first [1].

    References
    ----------
    L'Ecuyer (1999), *Good parameters and implementations for combined multiple recursive
    random number generators*, Operations Research 47(1), figure 1.
    """
    # Products are below 2^21 * 2^32 = 2^53, so that no digit is lost.
    p = _modulo(_A12 * first[1] - _A13 * first[0], _M1)
    q = _modulo(_A21 * second[2] - _A23 * second[0], _M2)
    # From 1 to m1, so that the result is neither 0, which has no logarithm, nor 1.
    difference = np.where(p > q, p - q, p - q + _M1)
    first = np.stack([first[1], first[2], p])
    return difference / (_M1 + 1.0), first, np.stack([second[1], second[2], q])


class Noise(Block):
    r"""Band-limited white Gaussian noise: independent normal numbers, each held for one sample time.

    Below half the sampling frequency, its two-sided power spectral density is about
    :math:`\sigma^2 T_s`. The numbers depend only on the seed and the instant: a run is reproducible with
    any solver, and up to round-off on any backend.

    Parameters
    ----------
    standard_deviation : array_like
        σ ≥ 0 [unit]; its shape is that of the output, whose elements are independent.
    sample_time : float
        T_s > 0 [s].
    seed : int
        Seed of the random numbers, at least 0 [1]; use a different one for each noise block.
    mean : array_like
        Mean value [unit].
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.

    Raises
    ------
    ParameterError
        If the standard deviation or the seed is negative, or the seed is not whole.
    BlockError
        If the sample time is not above 0.
    """

    y = Output("shape", unit=Attribute("unit"), meaning="noise")
    first = State((3, "size"), meaning="first recurrence of the generator")
    second = State((3, "size"), meaning="second recurrence of the generator")
    standard_deviation = Parameter(
        shape="shape", minimum=0.0, meaning="σ: standard deviation"
    )
    mean = Parameter(shape="shape", meaning="mean value")
    seed = Parameter(minimum=0.0, meaning="seed of the random numbers")
    _symbol = Symbol(
        curve="M2 13l3-6 3 11 3-14 3 15 3-9 3 5 3-12 3 15 3-9 3 6",
        caption="σ = {standard_deviation} {unit}",
    )

    def __init__(
        self,
        standard_deviation: npt.ArrayLike,
        sample_time: float,
        *,
        seed: int,
        mean: npt.ArrayLike = 0.0,
        unit: Unit = None,
    ) -> None:
        deviation = finite_array(
            "parameter 'standard_deviation' of Noise", standard_deviation
        )
        self.shape, self.unit = deviation.shape, unit
        self.size = prod(self.shape)
        super().__init__(standard_deviation=deviation, mean=mean, seed=seed)
        self.sampled(sample_time)

    def check_parameters(self, p: Signals) -> None:
        """Check that the seed is a whole number."""
        if p.seed != np.floor(p.seed):
            raise ParameterError(
                f"parameter 'seed' of {p.owner} is {p.seed}; it must be a whole number"
            )

    def _start(self, seed: Vector) -> tuple[Vector, Vector]:
        """Return the states of the generator for a seed."""
        # The seed sequence mixes its input: seeds 1 and 2 give unrelated states.
        words = (
            np.random.SeedSequence(int(seed))
            .generate_state(6 * self.size)
            .astype(float)
        )
        first, second = words.reshape(2, 3, self.size)
        # Words of 32 bits may exceed the moduli, which are slightly below 2^32.
        return first % _M1, second % _M2

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the initial state of the generator."""
        return self._start(p.seed)[name == "second"]

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return normal numbers from pairs of uniform ones (Box and Muller, 1958)."""
        radius, first, second = uniform(x.first, x.second)
        turn, _, _ = uniform(first, second)
        normal = np.sqrt(-2.0 * np.log(radius)) * np.cos(2.0 * np.pi * turn)
        return {"y": p.mean + p.standard_deviation * np.reshape(normal, self.shape)}

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the state of the generator after two numbers."""
        _, first, second = uniform(x.first, x.second)
        _, first, second = uniform(first, second)
        return {"first": first, "second": second}


class Drift(Noise):
    r"""Drifting bias: a random walk, or a first-order Gauss–Markov process.

    .. math:: b_{k+1} = \varphi\, b_k + K \sqrt{\tau (1 - \varphi^2) / 2}\; w_k, \qquad
              \varphi = e^{-T_s / \tau}

    is :math:`\dot b = -b/\tau + K w` at the samples, w being white noise of unit density. Its
    standard deviation settles at :math:`K \sqrt{\tau / 2}`; a random walk, :math:`\tau = \infty`, has
    :math:`K \sqrt{t}` and the Allan deviation :math:`K \sqrt{t / 3}`.

    Parameters
    ----------
    random_walk : float
        K ≥ 0 [unit/√s].
    sample_time : float
        T_s > 0 [s].
    seed : int
        Seed of the random numbers, at least 0 [1]; use a different one for each noise block.
    shape : int, tuple of int
        Shape of the output, whose elements are independent.
    correlation_time : float, optional
        τ > 0 [s]; by default infinite.
    initial_deviation : float
        Standard deviation of the bias at time 0, which also depends on the seed [unit].
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.

    Raises
    ------
    ParameterError
        If K or the seed is negative, or the seed is not whole.
    BlockError
        If a time is not above 0, or another number not finite.

    References
    ----------
    IEEE Std 952-1997, *Format guide and test procedure for single-axis interferometric fiber optic
    gyros*, annex C.
    """

    bias = State("shape", meaning="b: the bias")

    def __init__(
        self,
        random_walk: float,
        sample_time: float,
        *,
        seed: int,
        shape: int | tuple[int, ...] = (),
        correlation_time: float | None = None,
        initial_deviation: float = 0.0,
        unit: Unit = None,
    ) -> None:
        walk = finite("Drift", "random_walk", random_walk)
        step = finite("Drift", "sample_time", sample_time, above=0.0)
        self.initial_deviation = finite("Drift", "initial_deviation", initial_deviation)
        decay = 0.0
        if correlation_time is not None:
            decay = step / finite(
                "Drift", "correlation_time", correlation_time, above=0.0
            )
        self.memory = exp(-decay)
        # K sqrt(τ (1 - φ^2) / 2) with decay = T_s / τ; `expm1` keeps the digits of 1 -
        # φ^2 for slow processes. Its limit for τ = ∞ is K sqrt(T_s).
        growth = sqrt(step * -expm1(-2.0 * decay) / (2.0 * decay) if decay else step)
        super().__init__(
            np.full(as_shape("Drift", shape), walk * growth), step, seed=seed, unit=unit
        )

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the initial state of the generator, or the bias at time 0."""
        if name != "bias":
            return super().initial(name, p)
        # Another generator than that of the steps, so that the initial bias is
        # independent of them.
        drawn: Vector = np.random.default_rng(int(p.seed)).standard_normal(self.shape)
        return self.initial_deviation * drawn

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the bias."""
        return {"y": x.bias}

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the next bias and the next state of the generator."""
        step = super().output(t, x, u, p)["y"]
        return super().update(t, x, u, p) | {"bias": self.memory * x.bias + step}
