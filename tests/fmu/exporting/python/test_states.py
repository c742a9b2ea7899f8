"""States: saved, restored, written as bytes, in one instance and across two: equal to the bit."""

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException
from numpy.testing import assert_array_equal
from systems import ports

from trussflow.blocks import PythonFunction
from trussflow.blocks.framework.run_state import Running

COMMUNICATION_STEP = 0.01


def test_restored_run_is_the_same_to_the_bit(loop_fmu, instance):
    """By handle and by bytes, in the same instance and in another."""
    one, other = (instance(loop_fmu).start({"goal[1]": 1.0}) for _ in "ab")
    one.step(0, 7, COMMUNICATION_STEP)
    one.set({"goal[2]": 0.5, "law.gain": 3.0})  # not used by any step yet
    state = one.getFMUState()
    content = one.serializeFMUState(state)
    first = one.step(7, 17, COMMUNICATION_STEP)
    assert np.ptp(first[:, 1:], axis=0).max() > 0.1
    other.step(0, 3, COMMUNICATION_STEP)
    for again, as_bytes in ((one, False), (other, False), (one, True), (other, True)):
        back = again.deserializeFMUState(content) if as_bytes else state
        again.setFMUState(back)
        assert again.get("time") == 7 * COMMUNICATION_STEP
        assert_array_equal(again.step(7, 17, COMMUNICATION_STEP), first)
        if as_bytes:
            again.freeFMUState(back)
    one.freeFMUState(state)
    assert one.errors + other.errors == ""


def test_state_before_the_initialization(loop_fmu, instance):
    one = instance(loop_fmu)
    one.setupExperiment()
    one.set({"plant.release[1]": 0.7})
    state = one.getFMUState()
    one.start()
    assert one.get("plant.q[1]") == 0.7
    first = one.step(0, 5, COMMUNICATION_STEP)
    one.setFMUState(state)
    assert_array_equal(
        one.start({"plant.v[1]": 0.0}).step(0, 5, COMMUNICATION_STEP), first
    )
    assert one.errors == ""


def test_reset_is_a_new_beginning(loop_fmu, instance):
    one = instance(loop_fmu).start({"goal[1]": 1.0, "plant.stiffness": 5.0})
    one.step(0, 5, COMMUNICATION_STEP)
    one.reset()
    fresh = instance(loop_fmu).start()
    assert_array_equal(
        one.start().step(0, 10, COMMUNICATION_STEP),
        fresh.step(0, 10, COMMUNICATION_STEP),
    )


def test_bytes_that_are_no_state_are_refused(loop_fmu, instance):
    """Damaged, empty, and those of another FMU: the cause is logged, and no step is taken."""
    one = instance(loop_fmu).start()
    one.step(0, 2, COMMUNICATION_STEP)
    good = one.getFMUState()
    content = one.serializeFMUState(good)
    for bad, message in (
        (content[: len(content) // 2], "damaged or cut off"),
        (b"\x80\x04junk", "is no saved state"),
        (
            content.replace(b'"FMU": "', b'"FMU": "x'),
            "the state of something else: FMU is 'x",
        ),
        (content.replace(b'"touched"', b'"touchy"'), "it is damaged"),
    ):
        one.log.clear()
        one.setFMUState(one.deserializeFMUState(bad))
        assert message in one.errors
        with pytest.raises(FMICallException, match="discard"):
            one.doStep(2 * COMMUNICATION_STEP, COMMUNICATION_STEP)
        one.setFMUState(good)
        one.doStep(2 * COMMUNICATION_STEP, COMMUNICATION_STEP)
        one.setFMUState(good)


class SecretiveRun(Running):
    def __init__(self, block):
        self.output = block.output


class Secretive(PythonFunction):
    def open(self, p):
        return SecretiveRun(self)


def test_a_run_without_saved_state_is_refused(export, instance):
    fmu = export(Secretive(lambda u: 2 * u, 0.01, **ports(u=(), y=())))
    about = read_model_description(str(fmu)).coSimulation
    assert not about.canGetAndSetFMUstate
    assert not about.canSerializeFMUstate
    one = instance(fmu).start()
    one.doStep(0.0, COMMUNICATION_STEP)
    one.getFMUState()
    assert "has a state that it cannot save" in one.errors
