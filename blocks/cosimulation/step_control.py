r"""Communication step control by step doubling of the whole coupled system.

Each interval H is computed twice: in one step, and, from a snapshot of all members, in two steps of
H/2. The error of all schemes is proportional to H, so the error of the second result is about

.. math:: e = |y_H - y_{H/2}|.

The step is accepted if e is small enough. Otherwise the snapshot is restored and H reduced.

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
from trussflow.blocks.errors import DivergenceError, RunEndedError, SimulationError
from trussflow.blocks.framework.run_state import StepDiscardedError
from trussflow.blocks.support.types import Vector

SAFETY_FACTOR = 0.8
"""Safety factor of the next step [-]."""

STEP_EXPONENT = 0.5
"""Power of the error ratio by which the next step is chosen [-]: an error is proportional to H squared."""

RESERVE_SHARE = 0.5
"""Part of the tolerance in the reserve [-]."""

RESERVE_DRAW = 0.1
"""Part of the remaining reserve for one step [-]."""

ABSOLUTE_SHARE = 1e-3
"""Absolute tolerance [unit of the signal], as a part of the relative one."""

MAX_GROWTH = 2.0
"""Largest ratio of successive steps [-]."""

MIN_SHRINKAGE = 0.2
"""Smallest ratio of successive steps [-]."""


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
        self.steps = {
            "communication_steps": 0,
            "rejected_steps": 0,
            "discarded_steps": 0,
        }

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
    tolerance : float
        Tolerance relative to the largest magnitude of a signal so far [-].
    longest : int
        Longest step, in multiples of the grid [-].
    """

    def __init__(self, coupled: Coupled, tolerance: float, longest: int) -> None:
        super().__init__(coupled)
        self.tolerance = tolerance
        self.longest = longest

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
        size = np.abs(coupled.signals)
        reserve = np.full(size.shape, RESERVE_SHARE)
        number = 2
        failed = False
        while coupled.k < last:
            # `last` is even, so a remainder always has two halves.
            number = min(number, _even(self.longest), last - coupled.k)
            # For the two halves, and for a step that is repeated.
            saved = coupled.save()
            try:
                middle, whole = self._twice(saved, number)
            except (StepDiscardedError, DivergenceError, RunEndedError) as error:
                coupled.restore(saved)
                if number == 2:
                    raise self._too_short(error) from error
                self.steps["discarded_steps"] += 1
                # A shorter step may succeed: the members are back at its start.
                failed = True
                number = _even(number // 2)
                continue
            np.maximum(size, np.abs(coupled.signals), out=size)
            allowed = ABSOLUTE_SHARE * self.tolerance + self.tolerance * size
            # Per signal, the error of this step as a part of the whole tolerance.
            spent = np.abs(coupled.signals - whole) / allowed
            share = (1.0 - RESERVE_SHARE) * number / last
            ratios = spent / (share + RESERVE_DRAW * reserve)
            ratio = float(ratios.max(initial=0.0))
            # 1e-10 avoids a division by zero if the two results are equal.
            factor = SAFETY_FACTOR * max(ratio, 1e-10) ** -STEP_EXPONENT
            if ratio > 1.0:
                coupled.restore(saved)
                failed = True
                if number == 2:
                    raise self._too_inaccurate(int(np.argmax(ratios)), ratio)
                self.steps["rejected_steps"] += 1
                number = _even(
                    # At least one even step shorter, so that the loop ends.
                    min(int(number * max(factor, MIN_SHRINKAGE)), number - 2)
                )
                continue
            self.steps["communication_steps"] += 2
            # A signal that used less than its share saves the rest for jumps; one that
            # used more draws on the reserve.
            reserve += share - spent
            # The middle is logged before the end; the members
            # themselves stay at the end.
            end = coupled.k, coupled.signals.copy()
            coupled.k, coupled.signals[:] = middle
            reached()
            coupled.k, coupled.signals[:] = end
            reached()
            # After a rejected step the next one does not grow, as it would often be rejected again.
            number = _even(int(number * min(factor, 1.0 if failed else MAX_GROWTH)))
            failed = False

    def _refuse_unable(self) -> None:
        """Check that all members can be restored and have variable steps."""
        for ability, what in (
            ("restores", "cannot return to an earlier state"),
            ("varies", "have a fixed step"),
        ):
            if names := self.coupled.unable(ability):
                raise SimulationError(
                    f"cannot control steps by a tolerance: these members {what}: {', '.join(names)}; "
                    "use a fixed step"
                )

    def _twice(
        self, saved: tuple[object, ...], number: int
    ) -> tuple[tuple[int, Vector], Vector]:
        """Take one step, then two halves; return the middle point, and the result of the one step."""
        coupled = self.coupled
        # First the whole step, so that the members end with the better
        # result of the halves.
        coupled.step(number)
        whole = coupled.signals.copy()
        coupled.restore(saved)
        coupled.step(number // 2)
        middle = coupled.k, coupled.signals.copy()
        coupled.step(number // 2)
        return middle, whole

    def _smallest(self) -> str:
        coupled = self.coupled
        return f"at t = {coupled.time:g} s, with the smallest step of {coupled.time_of(2):g} s"

    def _too_short(self, error: Exception) -> Exception:
        if isinstance(error, DivergenceError | RunEndedError):
            return error
        return SimulationError(
            f"{error}; this was {self._smallest()}: shorter steps need a smaller step=..."
        )

    def _too_inaccurate(self, place: int, error: float) -> SimulationError:
        return SimulationError(
            f"cannot keep the tolerance {self._smallest()}: there the error of "
            f"{self.coupled.network.describe(place)} is {error:.3g} times the allowed one. Give a "
            f"larger tolerance, or a smaller step"
        )


def _even(number: int) -> int:
    """Return the number rounded down to an even one, but at least two."""
    return max(2, number - number % 2)
