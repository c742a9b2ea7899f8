"""A saved state goes on bit for bit: in another session, another process, and after a kill at any instant."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import count
from pathlib import Path

import campaign
import numpy as np
import pytest
import xarray as xr
from systems import HiddenSum

from trussflow.blocks import (
    Diagram,
    Noise,
    Relay,
    Session,
    Simulator,
    Sine,
    TransferFunction,
    TransportDelay,
    UnitDelay,
)
from trussflow.blocks.errors import (
    BlockError,
    DivergenceError,
    ParameterError,
    SimulationError,
    TimeLimitError,
)
from trussflow.blocks.framework.run_state import Running
from trussflow.blocks.results import log, streamed_log
from trussflow.blocks.results.state_file import write_state

SOLVERS = "rk4", "RK45", "auto"
STEP, LENGTH, EVERY = 0.01, 2.0, 0.25
MAX_KILLS = 100
HERE = Path(__file__).parent
ENVIRONMENT = os.environ | {"PYTHONPATH": f"{HERE}{os.pathsep}{HERE.parents[1]}"}
"""For processes that import this file."""


class DiceRun(Running):
    def __init__(self):
        self.generator, self.seen = np.random.default_rng(5), [0.0]

    def output(self, t, x, u, p):
        return {"y": np.array(self.seen[-1])}

    def update(self, t, x, u, p):
        self.seen = [*self.seen[-3:], float(u.u) + self.generator.standard_normal()]
        return {}

    def save(self):
        return self.generator.bit_generator.state, self.seen

    def restore(self, saved):
        self.generator.bit_generator.state, self.seen = saved[0], [*saved[1]]


class Dice(HiddenSum):
    """A Python block with a random generator of NumPy's and a memory of its own."""

    def open(self, p):
        return DiceRun()


def everything(**others):
    """Return noise, delays, modes with events, a Python block with a memory, and rates; `others` instead."""
    diagram = Diagram("everything")
    sine, noise, lag, late, relay, delay, dice = diagram.add(
        sine=Sine(2.0, 3.0),
        noise=Noise(1.0, 0.05, seed=3),
        lag=TransferFunction([1.0], [0.3, 1.0]),
        late=others.get("late", TransportDelay(0.33)),
        relay=Relay(0.2, -0.2),
        delay=UnitDelay(0.1),
        dice=others.get("dice", Dice(())).sampled(0.03),
    )
    sine + noise + dice >> lag >> late >> relay >> delay >> dice
    diagram.expose(y1=late.y, y2=delay.y, y3=dice.y, y4=lag.y)
    return diagram


def settings(solver):
    fixed = {"step": STEP} if solver == "rk4" else {}
    return {"solver": solver, "backend": "interpreted"} | fixed


@cache
def simulator(solver):
    return Simulator(everything(), log_step=STEP, **settings(solver))


@cache
def prototype(solver):
    return Session(everything(), **settings(solver))


def session(solver):
    running = prototype(solver).twin()
    running.start()
    return running


def watched(running, *times):
    """Advance from time to time [s]; return all outputs there [1]."""
    rows = []
    for time in times:
        running.advance(time)
        rows += [float(y) for y in running.outputs.values()]
    return rows


# -- sessions ----------------------------------------------------------------------------------


@pytest.mark.parametrize("time", [0.6371, campaign.only(0.0), campaign.only(0.3)])
@pytest.mark.parametrize("solver", SOLVERS)
def test_another_session_goes_on_from_a_file_bit_for_bit(solver, time, tmp_path):
    file, times = tmp_path / "half.state", [0.9, 0.9003, 1.1]
    first, second = session(solver), session(solver)
    watched(first, time)
    before = first.outputs
    snapshot = first.save(file)
    expected = watched(first, *times)
    assert np.ptp(expected) > 0.5
    watched(second, 0.5)
    for back in (file, snapshot, str(file)):
        second.restore(back)
        assert second.time == time
        assert second.outputs == before
        assert watched(second, *times) == expected


def test_files_of_something_else_are_refused_by_name(tmp_path):
    file, running = tmp_path / "half.state", session("rk4")
    running.save(file)
    for item, changed, message in (
        (
            everything(late=TransportDelay(0.34)),
            {},
            "diagram_hash is '.*' there, '.*' here$",
        ),
        (everything(), {"solver": "euler"}, "solver is 'rk4' there, 'euler' here$"),
        (everything(), {"step": 0.005}, r"step is 0\.01 there, 0\.005 here$"),
        (everything(), {"rtol": 1e-6}, "rtol is 1e-08 there, 1e-06 here$"),
        (everything(), {"atol": 1e-6}, "atol is 1e-10 there, 1e-06 here$"),
        (
            everything(),
            {"backend": "numpy"},
            "backend is 'interpreted' there, 'numpy' here$",
        ),
    ):
        wrong = Session(item, **(settings("rk4") | changed))
        with (
            wrong,
            pytest.raises(
                SimulationError,
                match=rf"cannot continue from '.*half\.state': .*{message}",
            ),
        ):
            wrong.restore(file)
    before = watched(running, running.time)
    file.write_bytes(file.read_bytes().replace(b'version": "', b'version": "9'))
    with pytest.raises(SimulationError, match="trussflow_version is '9"):
        running.restore(file)
    good = running.save()
    for name, value in (
        *(("now", value) for value in (1.0, Fraction(-1, 3), Fraction(10**400))),
        *(("origin", value) for value in (None, Fraction(10**30), Fraction(-(10**30)))),
        *((name, value) for name in "xdp" for value in (0.5, np.zeros(99))),
        *(
            (name, getattr(good, name) * scale)
            for name in "xp"
            for scale in (1j, np.nan)
        ),
        ("hidden", {}),
        ("sampled", 1),
    ):
        write_state(file, replace(good, **{name: value}), running.prepared.identity)
        with pytest.raises(
            SimulationError, match=rf"cannot restore .*\b{name}\b.* of the snapshot"
        ):
            running.restore(file)
        assert watched(running, running.time) == before
    write_state(file, replace(good, p=-good.p), running.prepared.identity)
    with pytest.raises(
        ParameterError, match=r"parameter 'standard_deviation' of .* must be at least 0"
    ):
        running.restore(file)
    with pytest.raises(
        SimulationError, match=r"cannot continue from '.*none': .*No such file"
    ):
        running.restore(tmp_path / "none")
    with pytest.raises(
        SimulationError, match=r"cannot save to '.*half\.state': .*[Nn]o such"
    ):
        running.save(tmp_path / "no" / "half.state")


def test_memory_that_cannot_be_written_names_its_block(tmp_path):
    class Odd(DiceRun):
        def save(self):
            return {"kept": [self.generator]}

    class Mute(Running):
        output = DiceRun.output
        seen = (0.0,)

    for kind, message in (
        (
            Odd,
            r"cannot save to '.*': block 'dice' keeps Generator\(PCG64\).*, which cannot be written",
        ),
        (Mute, r"cannot save: block 'dice' \(Opened\) has a state that it cannot save"),
    ):

        class Opened(Dice):
            def open(self, p):
                return kind()  # noqa: B023 - called before the next one comes

        diagram = everything(dice=Opened(()))
        running = Session(diagram, step=STEP, backend="interpreted")
        with running, pytest.raises(SimulationError, match=message):
            running.save(tmp_path / "a.state")
        with pytest.raises(SimulationError, match=message):
            # before anything is computed
            Simulator(diagram, step=STEP, backend="interpreted").run(
                1e9, stream_to=tmp_path / "a.nc", checkpoint_every=1.0
            )
    assert not list(tmp_path.glob("*.state"))


# -- runs --------------------------------------------------------------------------------------


def checkpointed(running, path, length=LENGTH, **changes):
    options = {"checkpoint_every": EVERY, "resume": True} | changes
    with running.run(length, stream_to=path, **options) as result:
        return result.load()


def check_same(found, expected):
    """Check that rows, times, units and what is said of the run are equal, but for when it was made."""
    changing = {"created", "wall_time"}
    # Counted since the last resumption.
    changing |= {"steps", "rejected_steps", "evaluations", "factorizations"}
    assert list(found.variables) == list(expected.variables)
    for name, values in expected.variables.items():
        assert found[name].values.tobytes() == values.values.tobytes(), name
        assert found[name].attrs == values.attrs
    for name in {*found.attrs, *expected.attrs} - changing:
        assert found.attrs[name] == expected.attrs[name], name


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch):
    monkeypatch.setattr(streamed_log, "PIECE_NUMBERS", 200)
    monkeypatch.setattr(log, "BUFFER_ROWS", 7)


@pytest.mark.parametrize("solver", ["rk4", "RK45", campaign.only("auto")])
def test_checkpoints_change_no_rows(solver, tmp_path):
    """Not a bit of fixed steps; adaptive solvers start afresh there, and stay within their tolerance."""
    running = simulator(solver)
    found = checkpointed(running, tmp_path / "run.nc")
    plain = running.run(LENGTH)
    if solver == "rk4":
        xr.testing.assert_equal(found, plain)
    else:
        xr.testing.assert_allclose(found, plain, rtol=0, atol=1e-5)
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc"]


KILLED = """
import os, sys, time
from test_checkpoints import Path, checkpointed, log, simulator, streamed_log
streamed_log.PIECE_NUMBERS, log.BUFFER_ROWS = 200, 7
running, path = simulator(sys.argv[1]), Path(sys.argv[2])
checkpointed(running, path.with_name("warm.nc"), 0.5)  # what takes long is imported now
for seconds in sys.stdin:
    child = os.fork()
    if not child:
        checkpointed(running, path)
        os._exit(0)
    time.sleep(float(seconds))
    os.kill(child, 9)
    print(os.waitpid(child, 0)[1], flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="kill -9")
@pytest.mark.parametrize(
    "solver, kills",
    [
        ("rk4", 1),
        campaign.only("rk4", 5 * campaign.SIZE),
        campaign.only("RK45", 5 * campaign.SIZE),
    ],
)
def test_a_run_killed_at_any_instant_goes_on_bit_for_bit(solver, kills, tmp_path):
    expected = checkpointed(simulator(solver), tmp_path / "whole.nc")
    random, path, resumed = (
        np.random.default_rng(13 + campaign.SEED),
        tmp_path / "run.nc",
        0,
    )
    arguments, pipe = [sys.executable, "-c", KILLED, solver, str(path)], subprocess.PIPE
    with subprocess.Popen(
        arguments, stdin=pipe, stdout=pipe, text=True, env=ENVIRONMENT
    ) as process:
        for number in range(kills + MAX_KILLS):
            if number >= kills and resumed:
                break
            print(random.uniform(0.0, 0.6), file=process.stdin, flush=True)
            if process.stdout.readline() == "0\n":  # it was complete before
                with xr.open_dataset(
                    path, engine="netcdf4", decode_cf=False
                ) as complete:
                    check_same(complete.load(), expected)
                path.unlink()
            resumed += (tmp_path / "run.nc.partial" / "checkpoint").exists()
        process.stdin.close()
    assert resumed
    check_same(checkpointed(simulator(solver), path), expected)
    # nothing stays
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "run.nc",
        "warm.nc",
        "whole.nc",
    ]


@pytest.fixture
def stop(monkeypatch):
    """Return a function that lets a run end with an error after a checkpoint, by its number."""
    original = streamed_log.StreamedLog.checkpoint

    def stop(running, path, number, error=KeyboardInterrupt):
        numbers = count(1)

        def checkpoint(log, *arguments):
            original(log, *arguments)
            if next(numbers) == number:
                raise error

        with monkeypatch.context() as patched:
            patched.setattr(streamed_log.StreamedLog, "checkpoint", checkpoint)
            with pytest.raises(error):
                checkpointed(running, path)

    return stop


@pytest.mark.parametrize("solver", ["RK45", campaign.only("rk4")])
def test_a_time_limit_and_errors_leave_a_run_that_can_be_resumed(
    solver, stop, tmp_path
):
    running, path = simulator(solver), tmp_path / "run.nc"
    expected = checkpointed(running, tmp_path / "whole.nc")
    for number, error in ((1, KeyboardInterrupt), (3, DivergenceError), (2, OSError)):
        stop(running, path, number, error)
        assert path.exists()  # the logged rows can be read, too
    with pytest.raises(TimeLimitError):
        checkpointed(running, path, time_limit=1e-3)
    check_same(checkpointed(running, path), expected)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.nc", "whole.nc"]


def test_a_run_may_be_resumed_to_go_on_for_longer(stop, tmp_path):
    running, path = simulator("rk4"), tmp_path / "run.nc"
    stop(running, path, 2)
    longer = checkpointed(running, path, LENGTH + 0.5)
    check_same(longer, checkpointed(running, tmp_path / "b.nc", LENGTH + 0.5))


def test_other_runs_are_not_resumed(stop, tmp_path):
    running, path = simulator("rk4"), tmp_path / "run.nc"
    stop(running, path, 4)
    for changed, message in (
        (
            {"parameters": {"sine.amplitude": 3.0}},
            r"parameter 'sine\.amplitude' is \[2\.0\] there, \[3\.0\] here$",
        ),
        (
            {"initial": {"delay.previous": 1.0}},
            r"initial 'delay\.\w+' is \[0\.0\] there, \[1\.0\] here$",
        ),
        ({"start": 1.0}, r"start is 0\.0 there, 1\.0 here$"),
        ({"checkpoint_every": 1.0}, r"checkpoint_every is 0\.25 there, 1\.0 here$"),
    ):
        with pytest.raises(
            SimulationError,
            match=rf"continue from '.*run\.nc\.partial.checkpoint': .*{message}",
        ):
            checkpointed(running, path, **changed)
    with pytest.raises(
        SimulationError, match=r"to end at t = 0\.01 s: .* of t = [0-9.]+ s;"
    ):
        checkpointed(running, path, 0.01)
    folder = tmp_path / "run.nc.partial"
    folder.chmod(0o777)
    with pytest.raises(
        SimulationError, match=r"from the folder '.*partial': it is another user's"
    ):
        checkpointed(running, path)
    folder.chmod(0o755)
    state = folder / "checkpoint"
    content = state.read_bytes()
    write_state(state, (0, 1), json.loads(content.partition(b"\n")[0])["of"])
    with pytest.raises(
        SimulationError,
        match=r"cannot continue from '.*checkpoint': it is no checkpoint",
    ):
        checkpointed(running, path)
    state.write_bytes(content)
    min(folder.glob("0*.nc")).unlink()
    with pytest.raises(
        SimulationError,
        match=r"some of the rows before it are not .*resume=True to start again",
    ):
        checkpointed(running, path)
    check_same(
        checkpointed(running, path, resume=False),
        checkpointed(running, tmp_path / "b.nc"),
    )


@pytest.mark.parametrize(
    "given, message",
    [
        (
            {"resume": True},
            "a run is resumed from checkpoints, which are kept beside the file",
        ),
        (
            {"checkpoint_every": 1.0},
            r'give stream_to="file\.nc", and checkpoint_every=',
        ),
        (
            {"resume": True, "stream_to": "run.nc"},
            "checkpoint_every=..., in seconds of sim",
        ),
        ({"checkpoint_every": 0.0, "stream_to": "run.nc"}, "checkpoint_every"),
        (
            {"checkpoint_every": 0.0151, "stream_to": "run.nc"},
            "checkpoint_every of 0.0151 s is not a whole",
        ),
        ({"resume": "yes", "stream_to": "run.nc"}, "resume"),
    ],
)
def test_settings_that_contradict_are_refused(given, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((SimulationError, BlockError), match=message):
        simulator("rk4").run(1.0, **given)
    assert not list(tmp_path.iterdir())
