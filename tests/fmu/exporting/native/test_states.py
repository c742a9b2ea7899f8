"""Saved states, many instances, and steps that fail."""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from numpy.testing import assert_array_equal
from systems import Ball, Level

from trussflow.blocks import Input, State

TIME_STEP = 0.01


class Diverging(Level):
    """x' = x^8 u: infinite at t = 1/7 for u = 1 and x(0) = 1."""

    u = Input(default=1.0)
    x = State(initial=1.0)

    def derivative(self, t, x, u, p):
        return {"x": x.x**8 * u.u}


def test_a_restored_state_runs_on_bit_by_bit(version, exported, instance, systems):
    """With sampled blocks inside, saved between their instants; also in a second instance."""
    path = exported(systems.hybrid(), version)
    one, two = instance(path).start({"target": 0.7}), instance(path).start()
    one.step(0, 33, TIME_STEP)
    state = one.getFMUState()
    content = one.serializeFMUState(state)
    first = one.step(33, 73, TIME_STEP)
    one.setFMUState(state)
    assert_array_equal(one.step(33, 73, TIME_STEP), first)
    assert not np.array_equal(two.step(0, 5, TIME_STEP)[-1], first[-1])
    other = two.deserializeFMUState(content)
    two.setFMUState(other)
    assert_array_equal(two.step(33, 73, TIME_STEP), first)
    one.freeFMUState(state)
    two.freeFMUState(other)


class Reversing(Ball):
    """It changes the velocity only, so that its height is zero but for round-off after a bounce."""

    def on_event(self, t, x, u, p, fired):
        return {"v": -p.restitution * x.v}


def test_a_state_at_an_event_has_had_the_event(exported, instance):
    path = exported(Reversing(), "3.0")
    one, two = (instance(path, earlyReturnAllowed=True).start() for _ in "ab")
    reached = one.doStep(0.0, 1.0)[3]
    two.setFMUState(two.deserializeFMUState(one.serializeFMUState(one.getFMUState())))
    for each in (one, two):
        each.doStep(reached, 0.01)
    assert_array_equal(two.get(), one.get())
    assert two.get("height") > 0.0


def test_bytes_of_another_fmu_are_refused(version, exported, instance, systems):
    one = instance(exported(systems.hybrid(), version)).start()
    two = instance(exported(systems.Oscillator(2), version, "two")).start()
    with pytest.raises(FMICallException):
        two.deserializeFMUState(one.serializeFMUState(one.getFMUState()))
    assert "no saved state of this FMU" in two.errors


@pytest.mark.parametrize("byte", [100, -1])
def test_damaged_bytes_are_refused(byte, exported, instance, systems):
    one = instance(exported(systems.hybrid(), "2.0")).start()
    content = bytearray(one.serializeFMUState(one.getFMUState()))
    content[byte] ^= 1
    with pytest.raises(FMICallException, match="error"):
        one.deserializeFMUState(bytes(content))
    assert "damaged" in one.errors


def test_after_a_failed_step_of_fmi_2_only_a_saved_state_helps(exported, instance):
    one = instance(exported(Diverging(), "2.0")).start()
    one.doStep(0.0, 0.1)
    state, before = one.getFMUState(), one.get("y")
    with pytest.raises(FMICallException, match="discard"):
        one.doStep(0.1, 0.1)
    assert "a state stopped being finite" in one.log[-1][1]
    assert 0.1 < one.getRealStatus(2) < 1 / 7 + 0.01  # fmi2LastSuccessfulTime
    assert np.isfinite(one.get("y")).all()
    with pytest.raises(FMICallException, match="error"):
        one.doStep(0.1, 0.01)
    assert "set a saved state, or reset" in one.errors
    one.setFMUState(state)
    assert one.get("y") == before
    one.doStep(0.1, 0.01)
    one.reset()
    one.start().doStep(0.0, 0.1)
    assert one.get("y") == before


def test_a_discarded_step_of_fmi_3_leaves_everything_as_it_was(exported, instance):
    one, other = (instance(exported(Diverging(), "3.0")).start() for _ in "ab")
    for each in (one, other):
        each.doStep(0.0, 0.1)
    before = one.get()
    with pytest.raises(FMICallException, match="discard"):
        one.doStep(0.1, 0.1)
    assert_array_equal(one.get(), before)
    for each in (one, other):
        each.doStep(0.1, 0.01)
    assert_array_equal(one.get(), other.get())
