"""Laws that no other test states: faults planted on purpose showed the gaps."""

import numpy as np
import pytest
import systems
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.blocks import (
    Diagram,
    LimitedIntegrator,
    Ramp,
    Session,
    TimeFunction,
    TransportDelay,
    ZeroOrderHold,
    simulate,
)
from trussflow.blocks.errors import ParameterError
from trussflow.blocks.framework.units import mismatch

TICK = 0.01

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)


@pytest.mark.parametrize("units", [("K", "degC"), ("degC", "K")])
def test_units_of_different_zeros_do_not_fit(units):
    assert "has another zero" in mismatch(*units)


def test_rows_are_logged_every_seventh_step():
    """Steps are scheduled in windows whose length is no multiple of seven."""
    diagram = systems.series(time=Ramp())
    result = simulate(diagram, 490 * 7 * TICK, step=TICK, log_step=7 * TICK)
    assert_allclose(result["time"], 7 * TICK * np.arange(491), rtol=1e-12)


def test_many_clocks_start_at_their_offset():
    diagram = systems.series(time=Ramp())
    for k in range(2, 9):
        diagram.time >> diagram.add(f"hold{k}", ZeroOrderHold(k * TICK, offset=TICK))
    result, tick = simulate(diagram, 20 * TICK, step=TICK), np.arange(21)
    for k in range(2, 9):
        sampled = np.where(tick < 1, 0, 1 + (tick - 1) // k * k)
        assert_allclose(result[f"hold{k}.y"], TICK * sampled, rtol=1e-12)


def test_a_refused_set_of_parameters_changes_none():
    with Session(systems.Oscillator(), step=TICK) as session:
        before = session.save().p
        with pytest.raises(ParameterError):
            session.tune({"Oscillator.stiffness": 1.0, "Oscillator.mass": -1.0})
        assert_array_equal(session.save().p, before)


def test_a_delay_restarts_twice_from_one_snapshot():
    """The signal after the snapshot differs, so nothing of the first continuation may remain."""
    with Session(TransportDelay(0.5), step=TICK) as session:
        session.set(u=1.0)
        session.advance(1.0)
        saved = session.save()
        for value in (2.0, 3.0):
            session.restore(saved)
            session.set(u=value)
            session.advance(2.0)
            assert session.outputs["y"] == pytest.approx(value)


def test_an_integrator_that_left_its_lower_limit_can_fall_again():
    rate = TimeFunction(
        lambda t: np.where(np.abs(t - 1.5) < 0.5, 1.0, -1.0), breakpoints=(1.0, 2.0)
    )
    diagram = Diagram("limits")
    diagram.add(rate=rate) >> diagram.add(area=LimitedIntegrator(lower=0.0))
    assert simulate(diagram, 2.5, step=TICK)["area.y"][-1] == pytest.approx(
        0.5, abs=2 * TICK
    )
