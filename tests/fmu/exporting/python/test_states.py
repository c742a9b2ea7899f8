"""States: saved, restored, written as bytes, in one instance and across two: equal to the bit."""

from collections.abc import Callable
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from trussflow.blocks import Input, Output, PythonFunction, Running

POINT = 0.01
Start = Callable[..., Any]


@pytest.mark.parametrize("as_bytes", [False, True])
def test_restored_run_is_the_same_to_the_bit(loop_fmu, slave, as_bytes):
    one, other = (slave(loop_fmu).start({"goal[1]": 1.0}) for _ in "ab")
    one.step(0, 7, POINT)
    one.set({"goal[2]": 0.5, "law.gain": 3.0})  # not used by any step yet
    state = one.fmu.getFMUstate()
    content = one.fmu.serializeFMUstate(state)
    first = one.step(7, 20, POINT)
    assert np.ptp(first[:, 1:], axis=0).max() > 0.1
    other.step(0, 3, POINT)
    for again in (one, other, one):
        back = again.fmu.deSerializeFMUstate(content) if as_bytes else state
        again.fmu.setFMUstate(back)
        assert again.get("time") == 7 * POINT
        np.testing.assert_array_equal(again.step(7, 20, POINT), first)
        if as_bytes:
            again.fmu.freeFMUstate(back)
    one.fmu.freeFMUstate(state)
    assert one.errors + other.errors == ""


def test_state_before_the_initialization(loop_fmu, slave):
    one = slave(loop_fmu)
    one.fmu.setupExperiment()
    one.set({"plant.release[1]": 0.7})
    state = one.fmu.getFMUstate()
    one.start()
    assert one.get("plant.q[1]") == 0.7
    first = one.step(0, 5, POINT)
    one.fmu.setFMUstate(state)
    np.testing.assert_array_equal(one.start({"plant.v[1]": 0.0}).step(0, 5, POINT), first)
    assert one.errors == ""


def test_reset_is_a_new_beginning(loop_fmu, slave):
    one = slave(loop_fmu).start({"goal[1]": 1.0, "plant.stiffness": 5.0})
    one.step(0, 5, POINT)
    one.fmu.reset()
    fresh = slave(loop_fmu).start()
    np.testing.assert_array_equal(one.start().step(0, 10, POINT), fresh.step(0, 10, POINT))


def test_bytes_that_are_no_state_are_refused(loop_fmu, slave):
    """Damaged, empty, and those of another FMU: the cause is told, and no step is taken."""
    one = slave(loop_fmu).start()
    one.step(0, 2, POINT)
    good = one.fmu.getFMUstate()
    content = one.fmu.serializeFMUstate(good)
    for bad, message in (
        (content[: len(content) // 2], "damaged or cut off"),
        (b"\x80\x04junk", "is no saved state"),
        (content.replace(b'"FMU": "', b'"FMU": "x'), "the state of something else: FMU is 'x"),
        (content.replace(b'"touched"', b'"touchy"'), "it is damaged"),
    ):
        one.log.clear()
        one.fmu.setFMUstate(one.fmu.deSerializeFMUstate(bad))
        assert message in one.errors
        with pytest.raises(FMICallException, match="discard"):
            one.fmu.doStep(2 * POINT, POINT)
        one.fmu.setFMUstate(good)
        one.fmu.doStep(2 * POINT, POINT)
        one.fmu.setFMUstate(good)


class SecretiveRun(Running):
    def __init__(self, block):
        self.output = block.output  # type: ignore[method-assign]


def test_what_cannot_be_restored_says_so(export, slave):
    class Secretive(PythonFunction):
        def open(self, p):
            return SecretiveRun(self)

    ports: dict[str, Any] = {"inputs": {"u": Input()}, "outputs": {"y": Output()}}
    fmu = export(Secretive(lambda u: 2 * u, 0.01, **ports))
    about = fmpy.read_model_description(str(fmu)).coSimulation
    assert not about.canGetAndSetFMUstate
    assert not about.canSerializeFMUstate
    one = slave(fmu).start()
    one.fmu.doStep(0.0, POINT)
    one.fmu.getFMUstate()
    assert "keeps what it cannot hand over" in one.errors
