"""Bisection brackets the robustness limit of each law, and returns NaN if there is none."""

import numpy as np
import pytest
from flight.limits import (
    IMPERFECTIONS,
    LAWS,
    MAX_BRACKET_RATIO,
    TRUSSES,
    robustness_limits,
    simulated,
)
from hypothesis import given
from hypothesis import strategies as st
from systems import assert_near

from trussflow.models.plant.tunable_truss import TunableTruss


def bisected(law, imperfection, limit):
    """Return the bounds of a law that succeeds on the mild side of a limit, and the tried values."""
    what, tried = IMPERFECTIONS[imperfection], []

    def simulate(trials, _):
        """All other laws and imperfections succeed."""
        chosen = [(one, name) == (law, imperfection) for one, name, _ in trials]
        values = np.array([value for *_, value in trials])
        tried.extend(values[chosen])
        mild = values <= limit if what.mild < what.severe else values >= limit
        return list(mild | ~np.array(chosen))

    return *robustness_limits(simulate)[imperfection, law], tried


@given(
    name=st.sampled_from([k for k, v in IMPERFECTIONS.items() if v.unit != "s"]),
    where=st.floats(0.01, 0.99),
)
def test_bisection_brackets_the_limit(name, where):
    what = IMPERFECTIONS[name]
    limit = float(what.mild * (what.severe / what.mild) ** where)
    best, worst, tried = bisected("mean axes", name, limit)
    low, high = sorted((best, worst))
    assert low <= limit <= high < MAX_BRACKET_RATIO * low
    assert len(tried) < 12


@given(
    law=st.sampled_from(list(LAWS)),
    steps=st.integers(0, 90),
    name=st.sampled_from(["hold", "delay"]),
)
def test_times_are_whole_steps_and_neighbours_or_close(law, steps, name):
    step = LAWS[law].step
    limit = min(steps * step, IMPERFECTIONS[name].severe - step) + 1e-9
    best, worst, tried = bisected(law, name, limit)
    assert best <= limit < worst
    assert worst - best < 1.5 * step or worst < MAX_BRACKET_RATIO * best
    assert_near(np.round(np.array(tried) / step), np.array(tried) / step, 1e-6)


def test_a_law_may_succeed_or_fail_with_all_values():
    best, worst, tried = bisected("mean axes", "payload", np.inf)
    assert best == IMPERFECTIONS["payload"].severe
    assert np.isnan(worst)
    assert len(tried) == 2
    best, worst, tried = bisected("mean axes", "payload", 0.0)
    assert np.isnan(best)
    assert worst == IMPERFECTIONS["payload"].mild
    assert len(tried) == 2


@pytest.mark.parametrize("name", IMPERFECTIONS)
@pytest.mark.parametrize("law", LAWS)
def test_an_imperfection_changes_hardware_or_truss(law, name):
    what, modes = IMPERFECTIONS[name], TunableTruss.consistent().dynamics.modes
    loops = [
        repr(
            TRUSSES[name](modes, value).data.mass
            if name in TRUSSES
            else LAWS[law].hardware(**{name: value})
        )
        for value in (what.mild, what.severe)
    ]
    assert loops[0] != loops[1]


def test_trials_are_simulated():
    """Within the first 20 ms, neither a payload nor a longer hold makes the paper's laws fail."""
    trials = [("published", "payload", 1.0), ("mode-neutral", "hold", 0.002)]
    assert simulated(trials, duration=0.02, executor="serial") == [True, True]
