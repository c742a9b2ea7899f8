"""Ctrl-C, wherever it falls."""

import contextlib
import gc
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import campaign
import numpy as np
import pytest
from systems import ring

from trussflow.blocks import Gain, Integrator, Session
from trussflow.blocks.support.interrupts import interruptible, uninterrupted


def wait_until(end):
    """Wait for Ctrl-C, but not for ever."""
    while time.monotonic() < end:
        # Not `pass`: CPython 3.13 lets what falls on the jump back of an empty loop out of the `with` around
        # it (its issue 130279).
        time.sleep(0.001)


def called_by_casadi():
    """Return a function that interrupts itself, and is taken for one of CasADi."""
    namespace = {"__name__": "casadi.casadi", "signal": signal}
    exec(
        "def converted():\n    signal.raise_signal(signal.SIGINT)\n    return 'went on'",
        namespace,
    )
    return namespace["converted"]


def test_ctrl_c_waits_until_casadi_is_done():
    went_on = ""
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt), interruptible():  # noqa: PT012
        went_on = called_by_casadi()()
        wait_until(started + 10.0)
    assert went_on == "went on"
    assert time.monotonic() - started < 5.0
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_is_swallowed_comes_again():
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt), interruptible():  # noqa: PT012
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        wait_until(started + 10.0)
    assert time.monotonic() - started < 5.0


def test_other_errors_that_it_became_are_ctrl_c():
    """An import of C code reports another error than Ctrl-C."""
    with pytest.raises(KeyboardInterrupt), interruptible():  # noqa: PT012
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise ImportError("numpy failed to import") from error


def test_elsewhere_it_comes_at_once():
    with pytest.raises(KeyboardInterrupt), interruptible(), interruptible():
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_handler_of_the_user_and_other_threads_are_left_alone():
    def own(*_):
        raise AssertionError("nobody interrupted")

    before = signal.signal(signal.SIGINT, own)
    try:
        with interruptible():
            assert signal.getsignal(signal.SIGINT) is own
    finally:
        signal.signal(signal.SIGINT, before)
    worked = []

    @interruptible()
    def work():
        worked.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert worked == [signal.default_int_handler]


@pytest.mark.parametrize("outer", [contextlib.nullcontext, interruptible])
def test_ctrl_c_waits_for_what_must_not_be_left_half_way(outer):
    went_on = False
    with pytest.raises(KeyboardInterrupt), outer(), uninterrupted():  # noqa: PT012
        signal.raise_signal(signal.SIGINT)
        wait_until(time.monotonic() + 0.01)
        went_on = True
    assert went_on
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("number", [5, campaign.only(100 * campaign.SIZE)])
@pytest.mark.parametrize("settings", [{"step": 1e-3}, {"solver": "Rodas5P"}])
def test_sessions_swallow_no_ctrl_c(settings, number, request):
    """In CasADi's interpreter, that is; one of three was swallowed, or became a SystemError.

    Nothing is collected meanwhile: finalizers, of what other tests left, swallow it in any Python.
    """
    diagram = ring("loop", state=Integrator([1.0, 2.0]), gain=Gain(-1.0))
    diagram.expose(y=diagram.state.y)
    swallowed = 0
    gc.collect()
    gc.disable()
    request.addfinalizer(gc.enable)
    with Session(diagram, backend="interpreted", **settings) as session:
        for delay in np.random.default_rng(7 + campaign.SEED).uniform(
            0.0, 0.02, number
        ):
            interrupt = threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT))
            session.start()
            try:
                interrupt.start()
                until, steps = time.monotonic() + 0.1, 0
                while time.monotonic() < until or interrupt.is_alive():
                    steps += 1
                    session.advance(steps * 1e-3)
                    session.row()
                time.sleep(0.5)  # it may have been put off at last
                swallowed += 1
            except KeyboardInterrupt:
                pass
            interrupt.join()
    assert swallowed == 0


IMPORT_SCRIPT = """
import signal, sys
from trussflow.blocks import Diagram, Integrator, Constant, simulate
class Finder:
    def find_spec(name, *_):
        if name == "pandas":
            sys.meta_path.remove(Finder)
            signal.raise_signal(signal.SIGINT)
diagram = Diagram("d")
one, state = diagram.add(one=Constant(1.0), state=Integrator())
one >> state
sys.meta_path.insert(0, Finder)
try:
    simulate(diagram, 1.0, step=0.1, backend="numpy")
except KeyboardInterrupt:
    print("stopped", "xarray" in sys.modules)
print(simulate(diagram, 1.0, step=0.1, backend="numpy").sizes["time"])
"""


def test_ctrl_c_leaves_no_module_half_imported():
    ended = subprocess.run(
        [sys.executable, "-c", IMPORT_SCRIPT],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.stdout.split() == ["stopped", "True", "11"], ended.stderr


SCRIPT_HEAD = """
import sys
from trussflow.blocks import *
diagram = Diagram("loop")
state, gain = diagram.add(state=Integrator([1.0, 2.0]), gain=Gain(-1.0))
state >> gain >> state
hold = diagram.add(hold=ZeroOrderHold(0.01))
state >> hold
def ready(): print("ready", flush=True)
try:
"""
SCRIPT_TAIL = """
except KeyboardInterrupt as error:
    print("stopped", getattr(error, "result", {}).keys())
"""
JOBS = {
    "interpreted": """
        simulator = Simulator(diagram, step=1e-3, backend="interpreted")
        simulator.run(1.0, progress=False)
        ready()
        simulator.run(1e6, progress=False)
    """,
    "adaptive": """
        simulator = Simulator(diagram, solver="RK45", backend="interpreted")
        simulator.run(1.0, progress=False)
        ready()
        simulator.run(1e6, progress=False)
    """,
    "streamed": """
        import tempfile
        from trussflow.blocks.results import log, streamed_log
        streamed_log.PIECE_SECONDS, log.BUFFER_ROWS = 0.0, 16
        simulator = Simulator(diagram, step=1e-3, backend="interpreted")
        simulator.run(1.0, progress=False)
        ready()
        simulator.run(1e6, progress=False, stream_to=tempfile.mkdtemp() + "/run.nc")
    """,
    "cosimulate": """
        ready()
        cosimulate(diagram, 1e6, step=0.01, backend="interpreted", progress=False)
    """,
    "linearize": """
        ready()
        while True: linearize(diagram, gain.u, state.y)
    """,
    "export": """
        import tempfile
        from trussflow.fmu import export
        ready()
        while True: export(Integrator(1.0), tempfile.mkdtemp() + "/one.fmu")
    """,
}
JOB_DELAYS = [
    (job, delay)
    for job in JOBS
    for delay in np.random.default_rng(5 + campaign.SEED).uniform(
        0.0, 1.0, 5 * campaign.SIZE
    )
]


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(
    "job, delay", [("streamed", 0.2), *(campaign.only(*case) for case in JOB_DELAYS)]
)
def test_ctrl_c_ends_every_job_soon(job, delay):
    code = (
        SCRIPT_HEAD + textwrap.indent(textwrap.dedent(JOBS[job]), "    ") + SCRIPT_TAIL
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        try:
            # half a second where nobody else works
            out, _ = process.communicate(timeout=30.0)
        finally:
            process.kill()
    assert out.startswith("stopped")
    if job in ("interpreted", "adaptive", "streamed"):
        assert "hold.y" in out
