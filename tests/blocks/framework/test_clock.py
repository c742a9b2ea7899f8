"""Exact time: floats stand for simple fractions, instants are integer ticks."""

from fractions import Fraction

import numpy as np
import pytest

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.clock import Clock, common_tick, exact, ticks
from trussflow.blocks.simulation.schedule import MAX_SCANNED_TICKS, Schedule


@pytest.mark.parametrize(
    "seconds, fraction",
    [
        (0.1 + 0.2, Fraction(3, 10)),
        (3 * 0.001, Fraction(3, 1000)),
        (1 / 3, Fraction(1, 3)),
        (1e-10, Fraction(1, 10**10)),
        (1.23456789012, Fraction(123456789012, 10**11)),
        (1.5e-9, Fraction(3, 2 * 10**9)),
        (1e6 + 0.001, Fraction(1_000_000_001, 1000)),
        (np.float64(0.25), Fraction(1, 4)),
        (7, Fraction(7)),
    ],
)
def test_floats_stand_for_simple_fractions(seconds, fraction):
    assert exact(seconds) == fraction


@pytest.mark.parametrize("seconds", [np.pi, np.sqrt(2) * 1e-3])
def test_other_floats_are_kept_to_round_off(seconds):
    assert float(exact(seconds)) == pytest.approx(seconds, rel=1e-14)


def test_common_tick_divides_all_times():
    times = [Fraction(1, 10), Fraction(3, 20), Fraction(0), Fraction(7, 5)]
    tick = common_tick(times)
    assert tick == Fraction(1, 20)
    assert [ticks(t, tick, "time") for t in times] == [2, 3, 0, 28]


def test_time_between_ticks_is_refused():
    with pytest.raises(
        SimulationError, match=r"the time of 0\.15 s is not a whole number of steps"
    ):
        ticks(Fraction(3, 20), Fraction(1, 10), "the time")


def test_more_ticks_than_64_bits_count_are_refused():
    with pytest.raises(
        SimulationError, match=r"the time of 10000000000000 s is more than 1e\+18"
    ):
        ticks(Fraction(10**13), Fraction(1, 10**6), "the time")


def clocks(*pairs):
    return [Clock(Fraction(period), Fraction(offset)) for period, offset in pairs]


def brute_force(found, tick):
    return frozenset(
        c for c in found if tick >= c.offset and (tick - c.offset) % c.period == 0
    )


@pytest.mark.parametrize(
    "given",
    [
        [],
        [(1, 0)],
        [(3, 0), (2, 0), (7, 0)],
        [(4, 1), (6, 3), (9, 2)],
        [(2, 0), (2, 1)],
        [(5, 4), (10, 9), (15, 14)],
    ],
)
def test_due_sets_are_those_that_tick(given):
    found = clocks(*given)
    schedule = Schedule(found, Fraction(1))
    due = [schedule.sets[i] for k in range(4) for i in schedule.due(100 * k, 100)]
    assert due == [brute_force(found, k) for k in range(400)]
    assert schedule.sets[0] == frozenset()
    assert set(schedule.sets) == {frozenset(), *due}, "only sets that occur get code"


def test_long_patterns_are_not_scanned_but_right():
    periods = (997, 1009, 1013)
    found = clocks(*((p, 0) for p in periods))
    assert np.prod(periods) > MAX_SCANNED_TICKS
    schedule = Schedule(found, Fraction(1))
    due = schedule.due(0, 3000)
    assert [schedule.sets[i] for i in due] == [
        brute_force(found, k) for k in range(3000)
    ]
    last = np.prod(periods)
    assert schedule.sets[schedule.due(last, 1)[0]] == frozenset(found)


def test_too_many_ways_to_coincide_are_refused():
    """Each set of clocks that tick together needs code of its own."""
    primes = (
        101,
        103,
        107,
        109,
        113,
        127,
        131,
        137,
        139,
        149,
        151,
        157,
        163,
        167,
        173,
        179,
        181,
    )
    with pytest.raises(
        SimulationError, match=r"17 sample times coincide in more than \d+ ways"
    ):
        Schedule(clocks(*((p, 0) for p in primes)), Fraction(1))


def test_many_clocks_that_share_ticks_are_fine():
    found = clocks(*((2**k, 0) for k in range(17)))
    assert len(Schedule(found, Fraction(1)).sets) == 18
