r"""Communication step control by step doubling of the whole coupled system.

Each interval H is computed twice: in one step, and, from a snapshot of all members, in two steps of
H/2. If the error of the scheme is proportional to :math:`H^p`, the error of the second result is about

.. math:: e = c |y_H - y_{H/2}|, \quad c = 1 / (2^p - 1).

The step is accepted if e is small enough. Otherwise the snapshot is restored and H reduced. Linear
extrapolation uses earlier points, whose distance does not scale with H. If the last step was r H, its
error is proportional to :math:`H^3 (1/3 + r/2)`, and to :math:`H^3 (7/48 + r/8)` for two halves.
Hence :math:`c = (7 + 6 r) / (9 + 18 r)`.

The errors of all steps add up to at most the tolerance. One half of the tolerance is proportional to
time: an interval H of a run of length T may add H/T of this half. The other half is a reserve for starts
and jumps, where the order is lower. An interval may use a tenth of the remaining reserve, and its unused
share is added to the reserve. The later propagation of an error by the system is not controlled: a stable
system reduces it, an unstable one amplifies it.

References
----------
E. Hairer, S. P. Norsett, G. Wanner, *Solving ordinary differential equations I*, II.4 (1993);
M. Arnold, C. Clauss, T. Schierz (2013), *Error analysis and error estimates for co-simulation in
FMI for model exchange and co-simulation V2.0*, Arch. Mech. Eng. LX(1).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trussflow.blocks.cosimulation.coupling import Coupled
from trussflow.blocks.framework.errors import DivergenceError, RunEndedError, SimulationError
from trussflow.blocks.framework.running import StepDiscardedError
from trussflow.blocks.framework.types import Vector

SAFETY_FACTOR = 0.8
"""Safety factor of the next step [-]."""

RESERVE_SHARE, RESERVE_DRAW = 0.5, 0.1
"""Part of the tolerance in the reserve, and part of the remaining reserve for one step [-]."""

MAX_GROWTH, MIN_SHRINKAGE = 2.0, 0.2
"""Largest and smallest ratio of successive steps [-]."""


class FixedSteps:
    """Fixed communication steps of the length of the grid.

    Parameters
    ----------
    coupled : Coupled
        The members.

    Attributes
    ----------
    steps : dict of str to int
        Numbers of steps that were accepted, rejected for their error, and discarded by a member [-].
    """

    def __init__(self, coupled: Coupled) -> None:
        self.coupled = coupled
        self.steps = {"communication_steps": 0, "rejected_steps": 0, "discarded_steps": 0}

    def run(self, last: int, reached: Callable[[], None]) -> None:
        """Advance to a point of the grid.

        Parameters
        ----------
        last : int
            The point to reach [-].
        reached : callable
            Called at each accepted communication point.

        Raises
        ------
        SimulationError
            If a member rejects a step.
        DivergenceError
            If a signal is not finite.
        """
        while self.coupled.k < last:
            try:
                self.coupled.step(1)
            except StepDiscardedError as error:
                if isinstance(error, RunEndedError):
                    raise
                raise SimulationError(
                    f"{error}; the communication step is fixed: use a smaller one, or step control "
                    "by tolerance=..."
                ) from error
            self.steps["communication_steps"] += 1
            reached()


class StepControl(FixedSteps):
    """Variable communication steps.

    Parameters
    ----------
    coupled : Coupled
        The members; one step of its grid is half the smallest step.
    relative, absolute : float
        Tolerance relative to the largest magnitude of a signal so far, and absolute tolerance
        [-, unit of the signal].
    longest : int
        Longest step, in multiples of the grid [-].

    Attributes
    ----------
    forgotten : list of int
        Grid points at which two successive steps were rejected, as after a jump, and the rates of the
        inputs were discarded [-].
    """

    def __init__(self, coupled: Coupled, relative: float, absolute: float, *, longest: int) -> None:
        super().__init__(coupled)
        self.relative, self.absolute, self.longest = relative, absolute, longest
        self.forgotten: list[int] = []

    def run(self, last: int, reached: Callable[[], None]) -> None:
        """Advance to a point of the grid.

        Parameters
        ----------
        last : int
            The point to reach, an even number [-].
        reached : callable
            Called at each accepted communication point.

        Raises
        ------
        SimulationError
            If the error is too large, or a member rejects the step, even with the smallest step.
        DivergenceError
            If a signal is not finite even with the smallest step.
        """
        coupled = self.coupled
        self._refuse_unable()
        exponent = 1.0 / (1.0 + coupled.scheme.convergence)
        size = np.abs(coupled.signals)
        reserve = np.full(size.shape, RESERVE_SHARE)
        number, before, failed = 2, 0, 0
        while coupled.k < last:
            number = min(number, _even(self.longest), last - coupled.k)
            saved = coupled.save()
            try:
                middle, whole = self._twice(saved, number)
            except (StepDiscardedError, DivergenceError, RunEndedError) as error:
                coupled.restore(saved)
                if number == 2:
                    raise self._too_short(error) from error
                self.steps["discarded_steps"] += 1
                failed = max(failed, 1)
                number = _even(number // 2)
                continue
            np.maximum(size, np.abs(coupled.signals), out=size)
            change = np.abs(coupled.signals - whole) * self._constant(before, number)
            spent = change / (self.absolute + self.relative * size)
            share = (1.0 - RESERVE_SHARE) * number / last
            ratios = spent / (share + RESERVE_DRAW * reserve)
            ratio = float(ratios.max(initial=0.0))
            factor = SAFETY_FACTOR * max(ratio, 1e-10) ** -exponent
            if ratio > 1.0:
                coupled.restore(saved)
                failed += 1
                if failed == 2 and coupled.scheme.extrapolation:
                    coupled.forget()
                    self.forgotten.append(coupled.k)
                    before = 0
                elif number == 2:
                    raise self._too_inaccurate(int(np.argmax(ratios)), ratio)
                self.steps["rejected_steps"] += 1
                number = _even(min(int(number * max(factor, MIN_SHRINKAGE)), number - 2))
                continue
            self.steps["communication_steps"] += 2
            reserve += share - spent
            end = coupled.k, coupled.signals.copy()
            coupled.k, coupled.signals[:] = middle
            reached()
            coupled.k, coupled.signals[:] = end
            reached()
            before = number // 2
            # After a rejected step the next one does not grow, as it would often be rejected again.
            number = _even(int(number * min(factor, 1.0 if failed else MAX_GROWTH)))
            failed = 0

    def _refuse_unable(self) -> None:
        """Check that all members can be restored and have variable steps."""
        for names, what in (
            (self.coupled.unrestorable(), "cannot return to an earlier state"),
            (self.coupled.unvarying(), "have a fixed step"),
        ):
            if names:
                raise SimulationError(
                    f"cannot control steps by a tolerance: these members {what}: {', '.join(names)}; "
                    "use a fixed step"
                )

    def _twice(self, saved: tuple[object, ...], number: int) -> tuple[tuple[int, Vector], Vector]:
        """Take one step, then two halves; return the middle point, and the result of the one step."""
        coupled = self.coupled
        coupled.step(number)
        whole = coupled.signals.copy()
        coupled.restore(saved)
        coupled.step(number // 2)
        middle = coupled.k, coupled.signals.copy()
        coupled.step(number // 2)
        return middle, whole

    def _constant(self, before: int, number: int) -> float:
        """Return the factor c of the difference of the two results in the error estimate."""
        scheme = self.coupled.scheme
        if scheme.extrapolation == 0:
            return 1.0
        if scheme.coupling == "iterate":
            return 1.0 / 3.0
        if before == 0:
            return 1.0  # without an earlier point, the first step holds its inputs
        ratio = before / number
        return (7.0 + 6.0 * ratio) / (9.0 + 18.0 * ratio)

    def _smallest(self) -> str:
        coupled = self.coupled
        return f"at t = {coupled.time:g} s, with the smallest step of {coupled.time_of(2):g} s"

    def _too_short(self, error: Exception) -> Exception:
        if isinstance(error, DivergenceError | RunEndedError):
            return error
        return SimulationError(f"{error}; this was {self._smallest()}: shorter steps need a smaller step=...")

    def _too_inaccurate(self, place: int, error: float) -> SimulationError:
        lines = "" if self.coupled.scheme.extrapolation else ", or use extrapolation=1"
        return SimulationError(
            f"cannot keep the tolerance {self._smallest()}: there the error of "
            f"{self.coupled.network.describe(place)} is {error:.3g} times the allowed one. Give a "
            f"larger tolerance or absolute_tolerance, or a smaller step{lines}"
        )


def _even(number: int) -> int:
    """Return the number rounded down to an even one, but at least two."""
    return max(2, number - number % 2)
