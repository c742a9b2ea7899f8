"""Exact time: sample times as fractions, instants as integer ticks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import gcd, lcm, ulp

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.block import Block

SNAP = Fraction(1, 10**6)
"""Largest deviation of a time from a whole number of steps [steps]; callers add up times with round-off."""

MAX_TICKS = 10**18
"""Largest number of ticks between two instants, which are counted in 64 bits [-]."""

MIN_ULPS = 10
"""Least length of a step, in distances of floating-point numbers at its time [-]."""


def exact(seconds: float) -> Fraction:
    """Return the simplest fraction that is equal to a float up to round-off: 0.1 gives 1/10.

    Parameters
    ----------
    seconds : float
        A time [s].
    """
    # repr() gives the shortest decimal of the float: 0.1, not 0.1000000000000000055...
    decimal = Fraction(repr(float(seconds)))
    # Up to 12 decimals count as typed; more of them, as in 1/3, come
    # from a computation.
    if decimal.denominator <= 10**12:
        return decimal
    # 0.3333333333333333 gives 1/3. A tiny time may have no such fraction near enough;
    # then its decimal is kept.
    simple = decimal.limit_denominator(10**9)
    return simple if abs(simple - decimal) <= abs(decimal) / 10**14 else decimal


_exact = lru_cache(exact)  # `Clock.of` is called many times for each block


@dataclass(frozen=True, slots=True, order=True)
class Clock:
    """Instants `offset` + k `period` [s]."""

    period: Fraction
    offset: Fraction

    @classmethod
    def of(cls, block: Block) -> Clock:
        """Return the clock of a sampled block."""
        return cls(_exact(block.sample_time or 0.0), _exact(block.sample_offset))


def common_tick(times: Iterable[Fraction]) -> Fraction:
    """Return the largest time [s] of which all `times` are integer multiples."""
    # Zero, such as an offset, is a multiple of every time.
    found = [t for t in times if t]
    # The gcd of fractions is the gcd of their numerators over a common denominator.
    denominator = lcm(*(t.denominator for t in found))
    return Fraction(gcd(*(int(t * denominator) for t in found)), denominator)


def ticks(
    time: Fraction,
    tick: Fraction,
    what: str,
    advice: str = "use a step that divides it, or an adaptive solver",
) -> int:
    """Return a time as a number of ticks.

    Parameters
    ----------
    time, tick : Fraction
        The time, and the length of a tick [s].
    what : str
        Name of the time, for messages.
    advice : str
        Remedy, for messages.

    Raises
    ------
    SimulationError
        If it is not a whole number.
    """
    number = time / tick
    if number.denominator != 1:
        raise SimulationError(
            f"{what} of {written(time)} s is not a whole number of steps of {written(tick)} s; {advice}"
        )
    if number > MAX_TICKS:
        raise SimulationError(
            f"{what} of {written(time)} s is more than {MAX_TICKS:.0e} steps of {written(tick)} s; {advice}"
        )
    return int(number)


def on_grid(time: Fraction, tick: Fraction) -> Fraction:
    """Return the nearest multiple of a tick if a time is equal to it up to round-off, else the time itself.

    Parameters
    ----------
    time, tick : Fraction
        The time, and the length of a tick [s].
    """
    nearest = round(time / tick) * tick
    # A time much shorter than a tick must not become zero.
    return nearest if nearest and abs(time - nearest) <= tick * SNAP else time


def refuse_coarse_time(time: float, step: Fraction | float) -> None:
    """Refuse a time at which floating-point numbers are too far apart for steps of a given length.

    Parameters
    ----------
    time : float
        The time [s].
    step : Fraction or float
        Length of the steps [s].

    Raises
    ------
    SimulationError
        If they are; the message gives the remedies.
    """
    apart = ulp(time)
    if apart * MIN_ULPS > step:
        raise SimulationError(
            f"steps of {written(step)} s are too short at t = {time:g} s, where floating-point numbers are "
            f"{apart:.2g} s apart: keep nearer to t = 0, or take steps of at least "
            f"{written(MIN_ULPS * apart)} s"
        )


def written(time: Fraction | float) -> str:
    """Return a time [s] as it is written in messages: all its digits, and no more."""
    return repr(float(time)).removesuffix(".0")
