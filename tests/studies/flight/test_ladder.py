"""Bisection finds where a loop ends, whatever the imperfection, and says so if it ends nowhere or at once."""

import numpy as np
import pytest
from flight.ladder import CLOSE, IMPERFECTIONS, LAWS, Rung, ladder
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from trussflow.models.plant.tunable_truss import TunableTruss


class Ends(Rung):
    """A rung whose law flies on the easy side of a value."""

    end: float

    def flies(self, law, what, value):
        return value <= self.end if what.easy < what.harsh else value >= self.end


def found(law, imperfection, end):
    rung = Ends(law=law, imperfection=imperfection)
    object.__setattr__(rung, "end", end)
    data = rung.compute()
    return float(data["flies"]), float(data["lost"]), data["value"].values.tolist()


@given(
    name=st.sampled_from([k for k, v in IMPERFECTIONS.items() if not v.of_time]), where=st.floats(0.01, 0.99)
)
def test_bisection_closes_in_on_the_end(name, where):
    what = IMPERFECTIONS[name]
    end = float(what.easy * (what.harsh / what.easy) ** where)
    flies, lost, tried = found("mean axes", name, end)
    low, high = sorted((flies, lost))
    assert low <= end <= high < CLOSE * low
    assert len(tried) < 12


@given(law=st.sampled_from(list(LAWS)), steps=st.integers(0, 90), name=st.sampled_from(["hold", "delay"]))
def test_times_are_whole_steps_and_neighbours_or_close(law, steps, name):
    step = LAWS[law].step
    end = min(steps * step, IMPERFECTIONS[name].harsh - step)
    flies, lost, tried = found(law, name, end + 1e-9)
    assert flies <= end + 1e-9 < lost
    assert lost - flies < 1.5 * step or lost < CLOSE * flies
    assert_allclose(np.round(np.array(tried) / step), np.array(tried) / step, rtol=0, atol=1e-6)


def test_what_flies_with_everything_is_lost_nowhere_and_the_other_way_round():
    flies, lost, tried = found("mean axes", "payload", np.inf)
    assert flies == IMPERFECTIONS["payload"].harsh
    assert np.isnan(lost)
    assert len(tried) == 2
    flies, lost, tried = found("mean axes", "payload", 0.0)
    assert np.isnan(flies)
    assert lost == IMPERFECTIONS["payload"].easy  # the easiest it is lost at
    assert len(tried) == 2


def test_all_laws_climb_all_rungs():
    assert len({rung.name for rung in ladder()}) == len(LAWS) * len(IMPERFECTIONS)


@pytest.mark.parametrize("name", IMPERFECTIONS)
@pytest.mark.parametrize("law", LAWS)
def test_an_imperfection_changes_hardware_or_truss(law, name):
    what, plant = IMPERFECTIONS[name], TunableTruss.consistent()
    easy, harsh = (
        (repr(what.hardware(LAWS[law], value)), what.truss(plant.dynamics.modes, value).data.mass)
        for value in (what.easy, what.harsh)
    )
    assert easy != harsh
