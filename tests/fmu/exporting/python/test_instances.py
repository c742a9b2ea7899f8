"""Many instances, instances that come and go, and instances after a failed step."""

import gc
import shutil
import sys
from collections import Counter

import campaign
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from numpy.testing import assert_array_equal
from systems import Level

COMMUNICATION_STEP = 0.01


class Growth(Level):
    """dx/dt = u exp(2 x): it reaches infinity at t = 1/(2 u), from x = 0."""

    def derivative(self, t, x, u, p):
        return {"x": u.u * np.exp(2.0 * x.x)}


@pytest.mark.parametrize("number", [5, campaign.only(50)])
def test_many_instances_at_once_do_not_mix(number, loop_fmu, instance):
    """Stepped in turns, each is as if it were alone."""
    goals = np.linspace(-1.0, 1.0, number)
    many = [instance(loop_fmu).start({"goal[1]": goal}) for goal in goals]
    for k in range(10):
        for one in many:
            one.doStep(k * COMMUNICATION_STEP, COMMUNICATION_STEP)
    ends = np.array([one.get() for one in many])
    for i in (0, number // 3, number - 1):
        alone = (
            instance(loop_fmu)
            .start({"goal[1]": goals[i]})
            .step(0, 10, COMMUNICATION_STEP)[-1]
        )
        assert_array_equal(ends[i], alone)
    assert len(np.unique(ends, axis=0)) == number
    assert "".join(one.errors for one in many) == ""


def census():
    """Count the objects of this package, and where modules are sought."""
    gc.collect()
    kinds = (type(thing) for thing in gc.get_objects())
    found = Counter(
        kind.__name__ for kind in kinds if str(kind.__module__).startswith("trussflow.")
    )
    return found + Counter({"path": len(sys.path), "modules": len(sys.modules)})


def test_instances_that_come_and_go_leave_nothing(loop_fmu, instance):
    def cycle():
        one = instance(loop_fmu).start({"goal[1]": 1.0})
        one.step(0, 2, COMMUNICATION_STEP)
        one.freeFMUState(one.getFMUState())
        one.free()

    for _ in range(3):
        cycle()
    before = census()
    for _ in range(6):
        cycle()
    assert census() == before


def test_unpacked_files_may_be_deleted(loop_fmu, instance, tmp_path):
    first = instance(loop_fmu).start()
    expected = first.step(0, 5, COMMUNICATION_STEP)
    first.free()
    shutil.rmtree(first.folder)
    again = instance(shutil.copy(loop_fmu, tmp_path / "again.fmu")).start()
    assert_array_equal(again.step(0, 5, COMMUNICATION_STEP), expected)


def test_after_a_failed_step_only_restoring_or_reset_help(export, instance):
    """The standard allows no step in this state; values may be read, for debugging."""
    one = instance(export(Growth())).start({"u": 0.1})
    one.step(0, 10, 0.1)
    state, good = one.getFMUState(), one.get("y")
    for way in ("restore", "reset"):
        one.set({"u": 100.0})
        with pytest.raises(FMICallException, match="discard"):
            one.doStep(1.0, 1.0)
        assert "'Growth.x' stopped being finite at t = 1." in one.errors
        one.log.clear()
        for time in (1.0, 1.001):
            with pytest.raises(FMICallException, match="discard"):
                one.doStep(time, 0.001)
        assert one.errors.count("restore a saved state, or reset") == 2
        one.log.clear()
        one.get("y")
        if way == "restore":
            one.setFMUState(state)
            assert one.get("y") == good
        else:
            one.reset()
            one.start({"u": 0.1}).step(0, 10, 0.1)
            assert one.get("y") == good
        assert one.errors == ""
