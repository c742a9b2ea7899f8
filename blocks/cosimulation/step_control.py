r"""Communication steps chosen by step doubling of the whole coupled system.

Each stretch H is taken twice: in one step, and, from a snapshot of all members, in two of H/2. With
a scheme whose error falls with :math:`H^p`, the second result is off by about

.. math:: e = c |y_H - y_{H/2}|, \quad c = 1 / (2^p - 1)

and is kept if e is small enough; else the snapshot is restored and H shortened. Extrapolated lines
start from the points before, which do not move as H does: with the last step being r H, their
error is proportional to :math:`H^3 (1/3 + r/2)` against :math:`H^3 (7/48 + r/8)` for two halves,
hence :math:`c = (7 + 6 r) / (9 + 18 r)`.

The errors of all steps add up to at most the tolerance. Half of it is spent in proportion to time:
a stretch H of a run of length T may add H/T of that. The other half is a reserve for starts and
jumps, where the order is lower: a stretch may add a tenth of what is left, and what a stretch does
not need of its share goes to the reserve. What the system itself makes of an error afterwards, a
stable one damping and an unstable one amplifying it, is not controlled.

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

SAFETY = 0.8
"""How much shorter than just allowed the next step is [-]."""

RESERVE, DRAW = 0.5, 0.1
"""Part of the tolerance that is not spent in proportion to time, and how much of what is left of it
one step may take [-]."""

GROWTH, SHRINKAGE = 2.0, 0.2
"""Most that a step grows or shrinks at once [-]."""


class FixedSteps:
    """Takes communication steps of the length of the grid.

    Parameters
    ----------
    coupled : Coupled
        The members.

    Attributes
    ----------
    steps : dict of str to int
        Communication steps kept, refused for their error, and refused by a member [-].
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
            Called at each communication point that is kept.

        Raises
        ------
        SimulationError
            If a member refuses a step.
        DivergenceError
            If a signal stops being finite.
        """
        while self.coupled.k < last:
            try:
                self.coupled.step(1)
            except StepDiscardedError as error:
                if isinstance(error, RunEndedError):
                    raise
                raise SimulationError(
                    f"{error}; steps are fixed here: take a smaller one, or let them be chosen "
                    "with tolerance=..."
                ) from error
            self.steps["communication_steps"] += 1
            reached()


class StepControl(FixedSteps):
    """Chooses communication steps.

    Parameters
    ----------
    coupled : Coupled
        The members; one step of its grid is half the smallest step.
    relative, absolute : float
        Tolerance relative to the largest size that a signal had, and absolute
        [-, unit of the signal].
    longest : int
        Longest step, in members of the grid [-].

    Attributes
    ----------
    forgotten : list of int
        Points of the grid at which two steps in a row were refused, as after a jump, and inputs
        were no longer extrapolated from before [-].
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
            Called at each communication point that is kept.

        Raises
        ------
        SimulationError
            If the error is too large, or a member refuses, even with the smallest step.
        DivergenceError
            If a signal stops being finite even with the smallest step.
        """
        coupled = self.coupled
        self._refuse_unable()
        exponent = 1.0 / (1.0 + coupled.scheme.convergence)
        size = np.abs(coupled.signals)
        reserve = np.full(size.shape, RESERVE)
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
            share = (1.0 - RESERVE) * number / last
            ratios = spent / (share + DRAW * reserve)
            ratio = float(ratios.max(initial=0.0))
            factor = SAFETY * max(ratio, 1e-10) ** -exponent
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
                number = _even(min(int(number * max(factor, SHRINKAGE)), number - 2))
                continue
            self.steps["communication_steps"] += 2
            reserve += share - spent
            end = coupled.k, coupled.signals.copy()
            coupled.k, coupled.signals[:] = middle
            reached()
            coupled.k, coupled.signals[:] = end
            reached()
            before = number // 2
            # After a refusal the next step does not grow: it would often be refused again.
            number = _even(int(number * min(factor, 1.0 if failed else GROWTH)))
            failed = 0

    def _refuse_unable(self) -> None:
        """Refuse members whose steps cannot be chosen."""
        for names, what in (
            (self.coupled.unrestorable(), "cannot go back to an earlier state"),
            (self.coupled.unvarying(), "take steps of one length only"),
        ):
            if names:
                raise SimulationError(
                    f"cannot choose steps by a tolerance: these members {what}: {', '.join(names)}; "
                    "take a fixed step"
                )

    def _twice(self, saved: tuple[object, ...], number: int) -> tuple[tuple[int, Vector], Vector]:
        """Take a step whole, then in two halves; return the point between, and the first result."""
        coupled = self.coupled
        coupled.step(number)
        whole = coupled.signals.copy()
        coupled.restore(saved)
        coupled.step(number // 2)
        middle = coupled.k, coupled.signals.copy()
        coupled.step(number // 2)
        return middle, whole

    def _constant(self, before: int, number: int) -> float:
        """Return what the difference of the two results is multiplied with."""
        scheme = self.coupled.scheme
        if scheme.extrapolation == 0:
            return 1.0
        if scheme.coupling == "iterate":
            return 1.0 / 3.0
        if before == 0:
            return 1.0  # the first step has no line to go by
        ratio = before / number
        return (7.0 + 6.0 * ratio) / (9.0 + 18.0 * ratio)

    def _smallest(self) -> str:
        coupled = self.coupled
        return f"at t = {coupled.time:g} s, with the smallest step of {coupled.time_of(2):g} s"

    def _too_short(self, error: Exception) -> Exception:
        if isinstance(error, DivergenceError | RunEndedError):
            return error
        return SimulationError(f"{error}; this was {self._smallest()}: shorter ones need a smaller step=...")

    def _too_inaccurate(self, place: int, error: float) -> SimulationError:
        lines = "" if self.coupled.scheme.extrapolation else ", or take extrapolation=1"
        return SimulationError(
            f"cannot keep the tolerance {self._smallest()}: there the error of "
            f"{self.coupled.network.describe(place)} is {error:.3g} times what is allowed. Give a "
            f"larger tolerance or absolute_tolerance, or a smaller step{lines}"
        )


def _even(number: int) -> int:
    """Return the largest even number that is not larger, but at least two."""
    return max(2, number - number % 2)
