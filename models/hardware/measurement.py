"""Measurement errors of sensors: sampling, noise, drift, quantization, delay."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.arithmetic import Sum
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.library.discrete import sampled_delay
from trussflow.blocks.library.noise import Drift, Noise
from trussflow.blocks.library.nonlinear import Quantizer
from trussflow.blocks.support.validation import as_shape, is_whole, shown
from trussflow.models.errors import ModelError
from trussflow.models.validation import check_number


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    r"""Sample time, noise, drift, quantization and delay of a sensor.

    .. math:: y(t) = Q(u_k + b_k + \sigma w_k), \quad t \ge k T_s + \delta

    Attributes
    ----------
    sample_time : float
        Sample time, T_s [s].
    noise : float
        Standard deviation of each sample, σ [unit].
    random_walk : float
        Random walk of the bias b, K of `Drift` [unit/√s].
    correlation_time : float, optional
        Correlation time of the bias, τ [s]; by default infinite.
    initial_bias : float
        Standard deviation of the bias at the start [unit].
    quantum : float
        Step of the quantization [unit], such as 2π / 2^b of an encoder of b bits; 0 for none.
    delay : float
        Delay of the output after the sample, δ [s].

    Raises
    ------
    ModelError
        If the sample time is not positive, or a number is negative.

    Notes
    -----
    A gyro with the angle random walk N and the bias instability B of its data sheet has
    :math:`\sigma = N / \sqrt{T_s}`, the initial bias B and, with a correlation time τ, the random walk
    :math:`B \sqrt{2 / \tau}`. This Gauss–Markov process replaces the flicker noise of the bias instability.

    An attitude is measured as its Euler angles, with their noise and quantum. The numbers of a quaternion
    have half of both, and the quaternion is normalized. The result is a rotation by the noise about each
    axis of the truss.
    """

    sample_time: float
    noise: float = 0.0
    random_walk: float = 0.0
    correlation_time: float | None = None
    initial_bias: float = 0.0
    quantum: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        check_number("a measurement", sample_time=self.sample_time)
        if self.correlation_time is not None:
            check_number("a measurement", correlation_time=self.correlation_time)
        others = ("noise", "random_walk", "initial_bias", "quantum", "delay")
        check_number(
            "a measurement", zero=True, **{name: getattr(self, name) for name in others}
        )

    def scaled(self, factor: float) -> Self:
        """Return the same measurement with scaled errors.

        Parameters
        ----------
        factor : float
            Factor of all errors, positive [1].
        """
        errors = ("noise", "random_walk", "initial_bias", "quantum")
        return replace(self, **{name: factor * getattr(self, name) for name in errors})

    def sensor(
        self,
        shape: int | tuple[int, ...],
        *,
        seed: int,
        initial_value: npt.ArrayLike = 0.0,
    ) -> Diagram:
        """Return a sensor with these errors.

        Parameters
        ----------
        shape : int or tuple of int
            Shape of the signal; each element has its own noise [-].
        seed : int
            Seed of the noise, zero or positive, different for each sensor [1].
        initial_value : array_like
            Output before the first sample [unit].

        Returns
        -------
        Diagram
            Sensor with the ports u and y.
        """
        shape = as_shape("a sensor", shape)
        errors: dict[str, Block] = {}
        if self.noise:
            deviation = np.full(shape, self.noise)
            errors["noise"] = Noise(
                deviation, self.sample_time, seed=derived_seed(seed, 0)
            )
        if self.random_walk or self.initial_bias:
            errors["bias"] = Drift(
                self.random_walk,
                self.sample_time,
                seed=derived_seed(seed, 1),
                shape=shape,
                correlation_time=self.correlation_time,
                initial_deviation=self.initial_bias,
            )
        diagram = Diagram("sensor")
        total, late = diagram.add(
            total=Sum("+" * (1 + len(errors))),
            late=sampled_delay(
                self.sample_time, self.delay, initial_value, shape=shape
            ),
        )
        for k, (name, block) in enumerate(errors.items(), 2):
            diagram.add(**{name: block}).y >> total.port(f"u{k}")
        seen = total.y
        if self.quantum:
            seen = (
                seen >> diagram.add(rounded=Quantizer(self.quantum, self.sample_time))
            ).y
        seen >> late.u
        diagram.expose(u=total.u1, y=late.y)
        return diagram


def derived_seed(seed: int, number: int) -> int:
    """Return an independent seed for each `number`, derived from one `seed`.

    Raises
    ------
    ModelError
        If the seed is not a whole number, zero or positive.
    """
    if not is_whole(seed) or seed < 0:
        raise ModelError(
            f"a sensor cannot have the seed {shown(seed)}; it must be a whole number from 0 on"
        )
    return int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
