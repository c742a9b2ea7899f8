"""The low-level classes of co-simulation, and child processes."""

import gc
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from trussflow.blocks.support.temporary_folders import process_folder
from trussflow.fmu import Fmu, FmuBinaryError, FmuCallError, FmuError
from trussflow.fmu.runtime.child_process import RemoteInstance, open_instance
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange
from trussflow.fmu.runtime.saved_states import HeldState


@pytest.fixture
def loaded(make_fmu):
    """Return a function that loads a model and sets it up."""
    with ExitStack() as stack:

        def make(model="ball", version=2, start=None, **changes):
            path = make_fmu(model, version, **changes)
            slave = stack.enter_context(LoadedCoSimulation(path))
            slave.setup(start=start)
            return slave

        yield make


def test_inputs_of_events_are_set_again_after_a_state_is_restored(loaded):
    """The inputs inside the FMU after going back are not those written last."""
    slave = loaded("types", 3, flags='hasEventMode="true"')
    one, two = (np.array([0.0, number, 0.0, 0.0, 0.0, 0.0]) for number in (1.0, 2.0))
    slave.set_inputs(one)
    state = slave.save_state()
    content = slave.state_to_bytes()
    for restore, saved in (
        (slave.restore_state, state),
        (slave.state_from_bytes, content),
    ):
        slave.set_inputs(two)
        assert slave.get_outputs()[1] == 3.0
        restore(saved)
        assert slave.get_outputs()[1] == 2.0
        slave.set_inputs(two)
        assert slave.get_outputs()[1] == 3.0
    slave.free_state(state)


def test_early_return_has_time_and_event(loaded):
    impact = np.sqrt(2 / 9.81)
    slave = loaded(version=3, flags='hasEventMode="true"')
    done = slave.do_step(0.0, 1.0)
    assert (done.early, done.event, done.discarded) == (True, True, False)
    assert done.time == pytest.approx(impact, abs=1e-15)
    assert slave.handle_event() is False
    slave.do_step(done.time, 0.125)
    height = 0.7 * 9.81 * impact * 0.125 - 9.81 * 0.125**2 / 2
    assert slave.get_outputs() == pytest.approx([height, 1.0], abs=1e-14)
    # Without event mode there is nothing to do at an event, so the step may end as it should.
    done = loaded(version=3, flags='mightReturnEarlyFromDoStep="true"').do_step(
        0.0, 1.0
    )
    assert (done.early, done.event, done.time) == (False, False, 1.0)


def test_a_discarded_step_has_its_last_time(loaded, version):
    slave = loaded(version=version, start={"fault": 6, "hmax": 0.1})
    done = slave.do_step(0.0, 0.2)
    assert (done.discarded, done.time) == (True, 0.0)
    assert slave.do_step(0.0, 0.1) == (0.1, False, False, False, False)


def test_dependencies(make_fmu, version):
    expected = {"y": ("u",), "next": ("number",), "inverse": ("flag",)}
    expected |= {"out": ("in_",)} if version == 3 else {}
    assert (
        Fmu(make_fmu("types", version), kind="cs", step=0.1).feedthrough() == expected
    )
    replaced = {'dependencies="1"': ""} if version == 2 else {'dependencies="6"': ""}
    unknown = Fmu(make_fmu("types", version, replace=replaced), kind="cs", step=0.1)
    # not stated: on everything
    assert unknown.feedthrough()["y"] == tuple(p.name for p in unknown.inputs())


def test_one_instance_per_process(make_fmu, version):
    path = make_fmu("ball", version, flags='canBeInstantiatedOnlyOncePerProcess="true"')
    with LoadedCoSimulation(path) as first, LoadedCoSimulation(path) as second:
        first.setup()
        first.setup()  # takes its own place
        with pytest.raises(FmuError, match="allows one instance in a process"):
            second.setup()
        first.close()
        second.setup()


def test_inputs_that_are_refused(loaded):
    slave = loaded("types", 3, start={"fault": 9, "flag": 0.0})
    with pytest.raises(FmuCallError, match=r"SetFloat64 returned(.|\n)*no such input"):
        slave.set_inputs()


def test_after_an_error_the_instance_is_only_freed(loaded, version):
    """The standards allow no fmi2Terminate then; our model logs it if it comes all the same."""
    slave = loaded(version=version, start={"fault": 2})
    with pytest.raises(FmuCallError, match="spring broke"):
        slave.do_step(0.0, 0.1)
    slave.close()
    assert slave.log == ("[error] the model says: the spring broke (number 42)",)


def test_after_a_fatal_error_there_is_no_other_instance(loaded):
    slave = loaded()
    with pytest.raises(FmuCallError, match="returned status 'fatal'"):
        slave._library.fail("DoStep", 4)
    with pytest.raises(
        FmuError, match="failed fatally before; close it and load it again"
    ):
        slave.setup()


def test_missing_functions_hurt_only_their_callers(loaded):
    """FMI 3's model has no fmi3GetString, which only reading text would need."""
    with pytest.raises(
        FmuBinaryError, match="has no function fmi3GetString; it was built"
    ):
        loaded(version=3)._library.function("GetString")


def test_an_instance_in_a_child_process_does_the_same(make_fmu, version):
    file = FmuFile.read(make_fmu("relay", version))
    found = []
    for time_limit in (None, 20.0):
        with open_instance(LoadedModelExchange, file, time_limit=time_limit) as model:
            model.setup(inputs=np.array([1.0, 0.0]), start={"x": 0.5})
            model.place(0.1, np.array([0.25]), np.array([0.75, 2.0]))
            assert model.event_inputs_changed(np.array([0.75, 2.0]))
            states, ended = model.handle_event(np.array([0.75, 2.0]))
            assert (states, ended) == (None, False)
            found.append(
                [
                    model.initial_states,
                    model.derivatives(),
                    model.indicators(),
                    model.next_time,
                    [v.name for v in model.inputs],
                    model.capabilities,
                    model.completed_step(),
                ]
            )
    for ours, theirs in zip(*found, strict=True):
        assert_array_equal(ours, theirs)
    assert found[0][1] == [-0.25 + 1 + 2]
    with pytest.raises(FmuError, match="has ended; set it up again"):
        model.setup()


def test_a_child_process_ends_with_its_parent(make_fmu, tmp_path):
    """Even if the parent is killed while the FMU does not return."""
    path = make_fmu("ball")
    script = (
        "from trussflow.fmu.runtime.child_process import RemoteInstance\n"
        "from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation\n"
        f"slave = RemoteInstance(LoadedCoSimulation, {str(path)!r}, 60.0)\n"
        "slave.setup(start={'fault': 3})\n"
        "print(slave._process.pid, flush=True)\n"
        "slave.do_step(0.0, 0.1)\n"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    parent = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        env=environment,
        text=True,
    )
    child = int(parent.stdout.readline())
    time.sleep(0.2)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return
        if Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
            return  # ended, and waits for whoever inherited it to take note
        time.sleep(0.1)
    os.kill(child, signal.SIGKILL)
    raise AssertionError("the child process went on without its parent")


def test_child_processes_need_posix(make_fmu, monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(FmuError, match="child processes for FMUs need a POSIX system"):
        RemoteInstance(LoadedCoSimulation, make_fmu("ball"), 20.0)


def test_interrupting_ends_the_child(make_fmu, monkeypatch):
    slave = RemoteInstance(LoadedCoSimulation, make_fmu("ball"), 20.0)
    process = slave._process

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Connection, "recv_bytes", interrupt)
    with pytest.raises(KeyboardInterrupt):
        slave.setup()
    assert process.poll() is not None


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_a_state_outlives_its_process(make_fmu):
    slave = RemoteInstance(LoadedCoSimulation, make_fmu("ball"), 20.0)
    slave.setup()
    closed, lost = HeldState(slave), HeldState(slave)
    slave._process.kill()
    slave._process.wait()  # sending to it fails from here on
    del lost
    gc.collect()
    slave.close()
    del closed
    gc.collect()


def test_one_call_of_a_child_at_a_time(make_fmu, monkeypatch):
    """A state that is freed while a call is under way must not take away its reply."""
    with RemoteInstance(LoadedCoSimulation, make_fmu("ball"), 20.0) as slave:
        slave.setup()
        states, receive = [HeldState(slave)], Connection.recv_bytes

        def free_meanwhile(*arguments):
            states.clear()
            gc.collect()
            return receive(*arguments)

        monkeypatch.setattr(Connection, "recv_bytes", free_meanwhile)
        assert slave.get_outputs().shape == (2,)
        assert slave.generation == 1


def test_a_child_that_refuses_is_ended(make_fmu):
    process_folder()  # whose lock stays open
    file, before = FmuFile.read(make_fmu("ball")), len(os.listdir("/proc/self/fd"))
    make_fmu("ball", replace={'start="9.81"': 'start="1.6"'})
    with pytest.raises(FmuError, match="was changed since it was read") as caught:  # noqa: F841
        RemoteInstance(LoadedCoSimulation, file, 20.0)
    assert len(os.listdir("/proc/self/fd")) == before  # while the error is still held
