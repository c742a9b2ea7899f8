"""Saved states, many instances, and steps that fail."""

import resource

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from trussflow.blocks import Block, Input, Output, State
from trussflow.fmu.exporting.description.export_interface import ExportInterface


def references(block):
    return {v.name: v.reference for v in ExportInterface.of(block).variables}


def run(fmu, first, steps):
    for k in range(first, first + steps):
        fmu.doStep(0.01 * k, 0.01)


class Diverging(Block):
    """x' = x^2 u: infinite at t = 1 for u = 1 and x(0) = 1."""

    u = Input(default=1.0)
    y = Output()
    x = State(initial=1.0)

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        return {"x": x.x**8 * u.u}


def saved(fmu):
    return fmu.getFMUstate() if hasattr(fmu, "setReal") else fmu.getFMUState()


def restore(fmu, state):
    (fmu.setFMUstate if hasattr(fmu, "setReal") else fmu.setFMUState)(state)


def release(fmu, state):
    (fmu.freeFMUstate if hasattr(fmu, "setReal") else fmu.freeFMUState)(state)


def packed(fmu, state):
    name = "serializeFMUstate" if hasattr(fmu, "setReal") else "serializeFMUState"
    return bytes(getattr(fmu, name)(state))


def unpacked(fmu, content):
    name = "deSerializeFMUstate" if hasattr(fmu, "setReal") else "deserializeFMUState"
    return getattr(fmu, name)(content)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_restored_state_runs_on_bit_by_bit(version, exported, tmp_path, fmi, systems):
    """With sampled blocks inside, saved between their instants; also in a second instance."""
    path, refs = exported(systems.hybrid(), version), references(systems.hybrid())
    with fmi.opened(path, "cs", tmp_path) as one, fmi.opened(path, "cs", tmp_path) as two:
        fmi.started(one, {refs["target"]: [0.7]})
        fmi.started(two)
        run(one, 0, 33)
        state = saved(one)
        content = packed(one, state)
        run(one, 33, 40)
        first = fmi.read(one, refs["position"], 1)
        restore(one, state)
        run(one, 33, 40)
        assert fmi.read(one, refs["position"], 1) == first
        assert not np.array_equal(fmi.read(two, refs["position"], 1), first)
        run(two, 0, 5)
        other = unpacked(two, content)
        restore(two, other)
        run(two, 33, 40)
        assert fmi.read(two, refs["position"], 1) == first
        release(one, state)
        release(two, other)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_bytes_of_another_fmu_are_refused(version, exported, tmp_path, fmi, systems):
    log: list[str] = []
    with fmi.opened(exported(systems.hybrid(), version), "cs", tmp_path) as one:
        fmi.started(one)
        content = packed(one, saved(one))
    path = exported(systems.Oscillator(2), version, "two")
    with fmi.opened(path, "cs", tmp_path, log) as two:
        fmi.started(two)
        with pytest.raises(FMICallException):
            unpacked(two, content)
    assert "no saved state of this FMU" in log[-1]


def test_fifty_instances_at_once(exported, tmp_path, fmi, systems):
    """Each with its own stiffness: as many trajectories as instances, as if each were alone."""
    from contextlib import ExitStack

    block = systems.Oscillator(1)
    path, refs = exported(block, "2.0", "one"), references(block)

    def prepared(fmu, i):
        fmi.started(fmu, {refs["stiffness"]: [1.0 + i]})

    with ExitStack() as stack:
        together = [stack.enter_context(fmi.opened(path, "cs", tmp_path)) for _ in range(50)]
        for i, fmu in enumerate(together):
            prepared(fmu, i)
        for k in range(20):
            for fmu in together:
                fmu.doStep(0.01 * k, 0.01)
        found = [fmi.read(fmu, refs["position"], 1)[0] for fmu in together]
    assert len(set(found)) == 50
    for i in (0, 17, 49):
        with fmi.opened(path, "cs", tmp_path) as alone:
            prepared(alone, i)
            run(alone, 0, 20)
            assert fmi.read(alone, refs["position"], 1)[0] == found[i]


def test_instances_leak_nothing(exported, tmp_path, fmi, systems):
    """A thousand cycles, each with a derivative, whose work space is 100 kB or more."""
    path = exported(systems.Wide(), "2.0")
    refs = references(systems.Wide())
    with fmi.opened(path, "cs", tmp_path) as fmu:

        def cycle():
            component = fmu.fmi2Instantiate(b"again", 1, fmu.guid.encode(), b"", fmu.callbacks, 0, 0)
            first, fmu.component = fmu.component, component
            fmi.started(fmu)
            fmu.doStep(0.0, 0.01)
            fmu.getDirectionalDerivative([refs["y"]], [refs["u"]], [1.0])
            state = fmu.getFMUstate()
            fmu.freeFMUstate(state)
            fmu.fmi2FreeInstance(component)
            fmu.component = first

        for _ in range(100):
            cycle()
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for _ in range(1000):
            cycle()
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 5000, f"{grown} kB more after 1000 cycles"


def test_after_a_failed_step_of_fmi_2_only_a_saved_state_helps(exported, tmp_path, fmi):
    log: list[str] = []
    path, refs = exported(Diverging(), "2.0"), references(Diverging())
    with fmi.opened(path, "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        fmu.doStep(0.0, 0.1)
        state, before = fmu.getFMUstate(), fmi.read(fmu, refs["y"], 1)
        with pytest.raises(FMICallException) as failure:
            fmu.doStep(0.1, 0.1)
        assert failure.value.status == 2  # fmi2Discard
        assert "a state stopped being finite" in log[-1]
        last = fmu.getRealStatus(2)  # fmi2LastSuccessfulTime
        assert 0.1 < last < 1 / 7 + 0.01
        assert np.isfinite(fmi.read(fmu, refs["y"], 1)).all()
        with pytest.raises(FMICallException) as failure:
            fmu.doStep(0.1, 0.01)
        assert failure.value.status == 3  # fmi2Error
        assert "set a saved state, or reset" in log[-1]
        fmu.setFMUstate(state)
        assert fmi.read(fmu, refs["y"], 1) == before
        fmu.doStep(0.1, 0.01)
        fmu.reset()
        fmi.started(fmu)
        fmu.doStep(0.0, 0.1)
        assert fmi.read(fmu, refs["y"], 1) == before


def test_a_discarded_step_of_fmi_3_leaves_everything_as_it_was(exported, tmp_path, fmi):
    path, refs = exported(Diverging(), "3.0"), references(Diverging())
    with fmi.opened(path, "cs", tmp_path) as fmu, fmi.opened(path, "cs", tmp_path) as other:
        for instance in (fmu, other):
            fmi.started(instance)
            instance.doStep(0.0, 0.1)
        before = fmi.read(fmu, refs["y"], 1)
        with pytest.raises(FMICallException) as failure:
            fmu.doStep(0.1, 0.1)
        assert failure.value.status == 2  # fmi3Discard
        assert fmi.read(fmu, refs["y"], 1) == before
        for instance in (fmu, other):
            instance.doStep(0.1, 0.01)
        assert fmi.read(fmu, refs["y"], 1) == fmi.read(other, refs["y"], 1)
