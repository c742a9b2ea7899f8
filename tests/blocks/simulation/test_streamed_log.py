"""Logs that are written while a run goes on: what was written survives whatever ends the run."""

import itertools
import os
import shutil
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import campaign
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose
from systems import assert_near, series

from trussflow.blocks import Integrator, Simulator, Sine, recover, save
from trussflow.blocks.errors import SimulationError, SimulationInterrupted
from trussflow.blocks.results import dataset, log, streamed_log
from trussflow.blocks.simulation import run

STEP = 1e-3


def diagram():
    return series(sine=Sine([1.0, 2.0], 3.0), integral=Integrator([0.0, 1.0]))


@pytest.fixture(scope="module")
def simulator():
    return Simulator(diagram(), step=STEP)


@pytest.fixture
def small_pieces(monkeypatch):
    """Let a piece be some hundred rows."""
    monkeypatch.setattr(streamed_log, "PIECE_NUMBERS", 1000)
    monkeypatch.setattr(log, "BUFFER_ROWS", 16)
    monkeypatch.setattr(run, "CHUNK_NUMBERS", 500)


@pytest.fixture(scope="module")
def whole(simulator):
    """Return the result of 3 s in memory."""
    return simulator.run(3.0)


def check_rows(found, whole):
    """Check that what was found is how the whole begins, to the last digit."""
    xr.testing.assert_equal(found, whole.isel(time=slice(found.sizes["time"])))


@pytest.mark.parametrize(
    "numbers, seconds",
    [
        (1, streamed_log.PIECE_SECONDS),
        (100, streamed_log.PIECE_SECONDS),
        (streamed_log.PIECE_NUMBERS, 0.0),
        (streamed_log.PIECE_NUMBERS, streamed_log.PIECE_SECONDS),
    ],
)
def test_streamed_result_equals_the_one_in_memory(
    numbers, seconds, solver, tmp_path, monkeypatch
):
    monkeypatch.setattr(streamed_log, "PIECE_NUMBERS", numbers)
    monkeypatch.setattr(streamed_log, "PIECE_SECONDS", seconds)
    simulator = Simulator(
        diagram(), step=0.1, solver=solver, log_step=0.1, backend="interpreted"
    )
    memory = simulator.run(5.0)
    streamed = simulator.run(5.0, stream_to=tmp_path / "run.nc")
    for result in (memory, streamed):
        for name in ("created", "wall_time"):
            del result.attrs[name]
    xr.testing.assert_identical(streamed.load(), memory)
    streamed.close()
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc"]


def test_streamed_run_takes_constant_memory(simulator, tmp_path):
    """Ten times the rows, the same peak: what waits is bounded."""

    def peak(duration):
        tracemalloc.start()
        simulator.run(duration, stream_to=tmp_path / "run.nc").close()
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    peak(1.0)
    bound = 4 * 8 * streamed_log.PIECE_NUMBERS + 16_000_000
    assert peak(1000.0) < bound < 1_000_000 * 5 * 8


@pytest.mark.usefixtures("small_pieces")
def test_a_run_that_goes_on_can_be_read(simulator, whole, tmp_path, monkeypatch):
    path, seen = tmp_path / "run.nc", []

    def saved(result, target, original=save):
        written = original(result, target)
        seen.append(recover(path))
        return written

    monkeypatch.setattr(streamed_log, "save", saved)
    simulator.run(3.0, stream_to=path).close()
    assert len(seen) > 5
    for before, after in itertools.pairwise(seen):
        assert after.sizes["time"] >= before.sizes["time"]
        check_rows(after, whole)
    assert seen[-1].sizes == whole.sizes
    assert seen[0].attrs["status"] == "running"
    with pytest.raises(SimulationError, match=r"nothing to recover .*run\.nc\.partial"):
        recover(path)


def interrupted(place, name, number, monkeypatch):
    """Let Ctrl-C come before or after a call, by its number."""
    original, calls = getattr(place, name), itertools.count()

    def disturbed(*args, **kwargs):
        half = next(calls) * 2
        if half == number:
            raise KeyboardInterrupt
        found = original(*args, **kwargs)
        if half + 1 == number:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(place, name, disturbed)


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("number", [4, *map(campaign.only, range(1, 12))])
@pytest.mark.parametrize(
    "place, name",
    [
        (streamed_log, "save"),
        (log, "dataset"),
        (log.Log, "_put_aside"),
        (log.Log, "reserve"),
        (log.Log, "keep"),
        (dataset, "replaced"),
    ],
)
def test_ctrl_c_within_the_log_loses_and_doubles_nothing(
    place, name, number, simulator, whole, tmp_path, monkeypatch
):
    with monkeypatch.context() as patched:
        interrupted(place, name, number, patched)
        with pytest.raises(SimulationInterrupted, match="stopped at") as stopped:
            simulator.run(3.0, stream_to=tmp_path / "run.nc")
    result = stopped.value.result
    assert result.attrs["status"] == "interrupted"
    last = float(result.time[-1]) if result.sizes["time"] else 0.0
    reached = float(str(stopped.value).split()[4])
    assert last <= reached <= last + 1.01 * STEP
    check_rows(result.load(), whole)
    result.close()
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc"]


@pytest.fixture
def full_disk(monkeypatch):
    """Let the disk be full after some files."""

    def after(number):
        left, original = itertools.count(), xr.Dataset.to_netcdf

        def to_netcdf(data, target, **settings):
            if next(left) >= number:
                Path(target).write_bytes(b"half")
                raise RuntimeError("NetCDF: HDF error")
            return original(data, target, **settings)

        monkeypatch.setattr(xr.Dataset, "to_netcdf", to_netcdf)

    return after


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("pieces", [0, 1, 4])
def test_a_full_disk_is_one_error_that_names_the_kept_pieces(
    pieces, simulator, whole, full_disk, tmp_path
):
    path = tmp_path / "run.nc"
    full_disk(pieces)
    message = r"cannot write .*run\.nc': NetCDF: HDF error \(is the disk full\? .* MB are free\)"
    with pytest.raises(SimulationError, match=message) as full:
        simulator.run(3.0, stream_to=path)
    assert ("recover(" in str(full.value)) == bool(pieces)
    assert "\n" not in str(full.value)
    if pieces:
        check_rows(recover(path), whole)
        assert len(list((tmp_path / "run.nc.partial").glob("*.nc"))) == pieces
    else:
        with pytest.raises(SimulationError, match="nothing to recover"):
            recover(path)
    assert not path.exists()


def test_a_file_that_cannot_be_joined_keeps_its_pieces(
    simulator, tmp_path, monkeypatch
):
    path, whole = tmp_path / "run.nc", simulator.run(1.0)

    def full(_log, target):
        target.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(streamed_log.StreamedLog, "_join", full)
        with pytest.raises(
            SimulationError, match=r"No space left on device; .* recover\("
        ):
            simulator.run(1.0, stream_to=path)
    check_rows(recover(path), whole)
    assert recover(path).sizes == whole.sizes
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc.partial"]


@pytest.mark.skipif(os.name != "posix", reason="no locks elsewhere")
def test_two_runs_do_not_write_to_one_place(simulator, tmp_path):
    path = tmp_path / "run.nc"
    first = streamed_log.StreamedLog([], {}, path)
    first.reserve(1)
    first.keep(0.0)
    with pytest.raises(
        SimulationError, match=r"another run is writing to .*run\.nc\.partial"
    ):
        simulator.run(0.1, stream_to=path)
    assert first.finish({}, status="complete").sizes == {"time": 1}


def interrupting(place, name, monkeypatch, of=""):
    """Let Ctrl-C come when a function begins, once; if `of` is given, with a path of that name."""
    original = getattr(place, name)

    def called(*args, **kwargs):
        if of and Path(args[0]).name != of:
            return original(*args, **kwargs)
        monkeypatch.setattr(place, name, original)
        signal.raise_signal(signal.SIGINT)
        return original(*args, **kwargs)

    monkeypatch.setattr(place, name, called)


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize(
    "place, name, of",
    [(shutil, "rmtree", "run.nc.partial"), (xr, "open_dataset", "run.nc")],
)
def test_ctrl_c_waits_for_files_that_are_deleted(
    place, name, of, simulator, whole, tmp_path, monkeypatch
):
    """The rest of the pieces was joined again, in place of all."""
    interrupting(place, name, monkeypatch, of)
    with pytest.raises(SimulationInterrupted, match="stopped at") as stopped:
        simulator.run(3.0, stream_to=tmp_path / "run.nc")
    result = stopped.value.result
    xr.testing.assert_equal(result.load(), whole)
    result.close()
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc"]


@pytest.mark.parametrize(
    "path", [None, 5, xr.Dataset(), "", "/", "x" * 300, "a\0b", "run.csv"]
)
def test_what_is_no_path_is_refused(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SimulationError, match=r"cannot (recover|read) ") as refused:
        recover(path)
    assert len(str(refused.value)) < 900


@pytest.mark.usefixtures("small_pieces")
def test_ctrl_c_leaves_pieces_of_which_damaged_ones_are_named(
    simulator, whole, tmp_path, monkeypatch
):
    path = tmp_path / "run.nc"
    interrupting(streamed_log.StreamedLog, "_join", monkeypatch)
    with pytest.raises(
        SimulationInterrupted, match=r"Ctrl-C came; the rows written before .*recover\("
    ):
        simulator.run(3.0, stream_to=path)
    xr.testing.assert_equal(recover(path), whole)
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc.partial"]
    last = sorted((tmp_path / "run.nc.partial").glob("*.nc"))[-1]
    content = last.read_bytes()
    for damaged in (b"", content[: len(content) // 2], b"x" * 1000):
        last.write_bytes(damaged)
        with pytest.raises(
            SimulationError, match=rf"cannot read .*{last.name}': .*; without it"
        ):
            recover(path)
    last.unlink()
    check_rows(recover(path), whole)


@pytest.mark.usefixtures("small_pieces")
def test_a_run_that_ends_while_it_is_read_is_complete(simulator, tmp_path, monkeypatch):
    path = tmp_path / "run.nc"
    simulator.run(1.0, stream_to=path).close()
    with pytest.raises(
        SimulationError, match=r"nothing to recover .*; but '.*' is there, and complete"
    ):
        recover(path)
    monkeypatch.setattr(
        streamed_log, "pieces_of", lambda folder: [folder / "000000000000000.nc"]
    )
    with pytest.raises(
        SimulationError, match=r"nothing to recover .*; but '.*' is there, and complete"
    ):
        recover(path)


KILLED = """
import sys
from test_streamed_log import Simulator, diagram, log, streamed_log
streamed_log.PIECE_NUMBERS, streamed_log.PIECE_SECONDS = 4_000, 1e9
simulator = Simulator(diagram(), step=1e-3, backend="numpy")
simulator.run(1e6, stream_to=sys.argv[1])
"""


KILL_TIMES = np.random.default_rng(11 + campaign.SEED).uniform(
    0.0, 0.5, 3 * campaign.SIZE
)
"""Times from the first piece to the kill [s]."""


@pytest.mark.skipif(os.name != "posix", reason="kill -9")
@pytest.mark.parametrize("delay", [0.2, *map(campaign.only, KILL_TIMES)])
def test_written_rows_survive_a_kill(delay, simulator, tmp_path):
    path, folder = tmp_path / "run.nc", tmp_path / "run.nc.partial"
    here = Path(__file__).parent
    environment = os.environ | {"PYTHONPATH": f"{here}{os.pathsep}{here.parents[1]}"}
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)], env=environment
    ) as process:
        while not list(folder.glob("*.nc")) and process.poll() is None:
            time.sleep(0.01)
        time.sleep(delay)
        before = len(list(folder.glob("[0-9]*.nc")))
        process.send_signal(signal.SIGKILL)
    rows = recover(path)
    assert before >= 1
    assert rows.sizes["time"] >= before * 4_000 // 6
    assert_allclose(rows.time, np.arange(rows.sizes["time"]) * STEP, rtol=1e-12)
    expected = simulator.run(float(rows.time[-1]))
    assert_near(rows["integral.y"], expected["integral.y"], 1e-9)
    simulator.run(0.1, stream_to=path).close()  # the next run works, and leaves nothing
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc"]
