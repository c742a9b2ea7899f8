"""Failures of sweeps, workers and samples: no finished sample is lost or run twice."""

import itertools
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import campaign
import cloudpickle
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_array_equal
from systems import decay

from trussflow.blocks import sweep
from trussflow.blocks.errors import SimulationError, SimulationInterrupted
from trussflow.blocks.sweeps import chunk_store

LONG_LIMIT = 10.0  # [s] for samples that end by themselves, however busy the machine is

SWEEP_SCRIPT = """
import sys, time
from pathlib import Path
from trussflow.blocks import Diagram, Gain, Integrator, sweep

diagram = Diagram("decay")
x, back = diagram.add(x=Integrator(1.0), back=Gain(-1.0))
x >> back >> x

def keep(run):
    with open("done", "a") as file:
        file.write(f"{run.attrs['parameters']}\\n")
    time.sleep(0.003)
    return float(run["x.y"][-1])

gains = [-k / 100 for k in range(1, 101)]
settings = {"step": 0.1, "path": "kept", "workers": int(sys.argv[1])}
found = sweep(diagram, 1.0, vary={"back.gain": gains}, keep={"end": keep}, **settings)
found.to_netcdf("found.nc")
"""
"""A sweep of 100 samples, which write down themselves that they ran."""

# workers cannot import tests
cloudpickle.register_pickle_by_value(sys.modules[__name__])


def swept(gains, keep, **settings):
    return sweep(
        decay(()),
        vary={"back.gain": gains},
        keep={"end": keep},
        **{"duration": 1.0, "step": 0.1} | settings,
    )


def end(run):
    return float(run["x.y"][-1])


def gain(run):
    return round(float(run.attrs["parameters"].split("[")[-1].strip("]}")), 12)


@pytest.mark.skipif(os.name != "posix", reason="kill -9")
@pytest.mark.parametrize(
    "number", [0, *(campaign.only(1 + k) for k in range(3 * campaign.SIZE))]
)
def test_a_sweep_that_is_killed_goes_on_where_it_was(number, tmp_path):
    finished, done = (
        np.random.default_rng(number + campaign.SEED).integers(0, 100),
        tmp_path / "done",
    )
    workers = "2" if number else "1"
    command = [sys.executable, "-c", SWEEP_SCRIPT, workers]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE) as process:
        while finished and (
            not done.exists() or len(done.read_text().splitlines()) < finished
        ):
            time.sleep(0.01)
        process.kill()
    time.sleep(0.5)  # its workers end by themselves
    kept = [
        n
        for f in (tmp_path / "kept").glob("[0-9]*.nc")
        for n in xr.load_dataset(f)["sample"].values
    ]
    assert len(set(kept)) == len(kept)
    subprocess.run(command, cwd=tmp_path, check=True, timeout=100)
    found = xr.load_dataset(tmp_path / "found.nc")
    assert found["sample"].values.tolist() == list(range(100))
    assert_array_equal(
        found["end"], swept(found["back.gain"].values, end, executor="serial")["end"]
    )
    ran = Counter(done.read_text().splitlines())
    again = [line for line, times in ran.items() if times > 1]
    # What was under way: workers with a task each, and what waited for a second.
    assert max(ran.values()) <= 2
    assert not {f"{-(n + 1) / 100}" for n in kept} & {
        line.split("[")[-1].strip("]}") for line in again
    }


def test_a_worker_that_dies_costs_its_samples_a_retry(tmp_path):
    def keep(run):
        if gain(run) == -0.5:
            os.kill(os.getpid(), signal.SIGKILL)
        if gain(run) == -0.7 and not (tmp_path / "died").exists():
            (tmp_path / "died").touch()
            os._exit(3)
        return end(run)

    found = swept(-np.linspace(0.1, 2.0, 20), keep, workers=1)
    assert found["sample"].values[found["status"] != "complete"].tolist() == [4]
    assert found["status"].values[4] == "lost"
    message = "its worker ended twice: the process that ran it ended with exit code -9"
    assert found["message"].values[4] == message


def test_samples_have_a_time_limit_each():
    """Stop a sample that looks at the clock between steps, and one that never does."""

    def keep(run):
        while gain(run) == -2.0:
            time.sleep(0.01)
        return end(run)

    found = swept([-1.0, -2.0, -3.0], keep, workers=1, time_limit=LONG_LIMIT)
    assert found["status"].values.tolist() == ["complete", "timeout", "complete"]
    assert (
        found["message"].values[1]
        == "it did not stop at its time limit, so its process was ended"
    )
    slow = sweep(
        decay(()),
        1000.0,
        vary={"back.gain": [-1.0]},
        keep={"x.y": "final"},
        executor="serial",
        time_limit=0.2,
        step=1e-6,
        log_step=1.0,
    )
    assert slow["status"].values.tolist() == ["timeout"]
    assert (
        slow["message"].values[0]
        == "the run takes longer than 0.2 s; the logged data are kept"
    )


def test_a_folder_of_something_else_is_refused(tmp_path):
    def again(**changed):
        usual = {"gains": [-1.0, -2.0], "keep": end, "executor": "serial"}
        return swept(**usual | {"path": tmp_path / "kept"} | changed)

    first = again()
    xr.testing.assert_equal(first, again())
    with pytest.raises(
        SimulationError, match=r"kept' holds another sweep: its keep differ"
    ):
        again(keep=gain)
    for changed, names in (
        ({"gains": [-1.0]}, "vary"),
        ({"duration": 2.0}, "duration"),
        ({"step": 0.05}, "settings"),
        ({"log": {"it": "x.y"}}, "log"),
        ({"not_finite": "ignore"}, "not_finite"),
    ):
        with pytest.raises(SimulationError, match=f"another sweep: its {names} differ"):
            again(**changed)
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(
        SimulationError,
        match="is no folder of a sweep, and not empty; give another path",
    ):
        again(path=tmp_path)
    with pytest.raises(SimulationError, match="cannot write"):
        again(path=tmp_path / "thesis.tex")
    piece = next((tmp_path / "kept").glob("[0-9]*.nc"))
    piece.write_bytes(b"half")
    with pytest.raises(
        SimulationError, match=r"cannot read .* the same call runs its samples again"
    ):
        again()
    piece.unlink()
    xr.testing.assert_equal(first, again())
    (tmp_path / "kept" / "sweep.json").write_text("{")
    with pytest.raises(
        SimulationError, match=r"continue the sweep of .*json': it is damaged \(Exp"
    ):
        again()


def test_two_sweeps_do_not_write_to_one_folder(tmp_path):
    def keep(run):
        with pytest.raises(SimulationError, match="another sweep is writing to"):
            swept([-1.0, -2.0], end, path=tmp_path, executor="serial")
        return end(run)

    assert (
        swept([-1.0, -2.0], keep, path=tmp_path, executor="serial")["status"]
        == "complete"
    ).all()


def test_a_full_disk_is_one_error_and_nothing_that_was_written_is_lost(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(chunk_store, "PIECE_SECONDS", 0.0)
    left, original = itertools.count(), xr.Dataset.to_netcdf

    def keep(run):
        with (tmp_path / "ran").open("a") as file:
            file.write("x")
        return end(run)

    def full(data, target, **settings):
        if next(left) == 3:
            Path(target).write_bytes(b"half")
            raise RuntimeError("NetCDF: HDF error")
        return original(data, target, **settings)

    monkeypatch.setattr(xr.Dataset, "to_netcdf", full)
    gains = -np.arange(1.0, 11.0)
    with pytest.raises(
        SimulationError,
        match=r"is the disk full\?.*the same call continues with the others",
    ):
        swept(gains, keep, path=tmp_path / "kept", executor="serial")
    found = swept(gains, keep, path=tmp_path / "kept", executor="serial")
    assert found["sample"].values.tolist() == list(range(10))
    # what could not be written, and what was under way
    assert len((tmp_path / "ran").read_text()) <= 10 + 2


def test_many_small_pieces_become_one(monkeypatch, tmp_path):
    monkeypatch.setattr(chunk_store, "PIECE_SECONDS", 0.0)
    monkeypatch.setattr(chunk_store, "SMALL_PIECES", 5)
    found = swept(-np.arange(1.0, 31.0), end, path=tmp_path, executor="serial")
    assert len(list(tmp_path.glob("[0-9]*.nc"))) < 5
    xr.testing.assert_equal(found, swept(-np.arange(1.0, 31.0), end, executor="serial"))


def test_ctrl_c_leaves_what_is_finished(tmp_path):
    def keep(run):
        if gain(run) == -7.0 and not (tmp_path / "stopped").exists():
            (tmp_path / "stopped").touch()
            raise KeyboardInterrupt
        return end(run)

    gains = -np.arange(1.0, 11.0)
    with pytest.raises(
        SimulationInterrupted, match="the same call continues with those in"
    ) as stopped:
        swept(gains, keep, path=tmp_path / "kept", executor="serial")
    result = stopped.value.result
    assert 1 <= result.sizes["sample"] <= 6
    assert (
        swept(gains, keep, path=tmp_path / "kept", executor="serial").sizes["sample"]
        == 10
    )


def test_an_executor_that_breaks_is_one_error(tmp_path):
    def keep(run):
        if gain(run) == -7.0:
            os._exit(1)
        return end(run)

    wanted = r"the workers cannot continue: Broken.*; (\d+) of 10 samples are finished and kept"
    with (
        ProcessPoolExecutor(1) as pool,
        pytest.raises(SimulationError, match=wanted) as broken,
    ):
        swept(-np.arange(1.0, 11.0), keep, path=tmp_path, executor=pool)
    said = re.search(wanted, str(broken.value))
    kept = [
        n
        for f in tmp_path.glob("[0-9]*.nc")
        for n in xr.load_dataset(f)["sample"].values
    ]
    assert len(kept) == int(said[1]) > 0


def test_what_cannot_be_sent_is_said_at_once():
    lock = threading.Lock()
    with pytest.raises(SimulationError, match="cannot pickle 'decay' for workers"):
        swept([-1.0], lambda _: float(lock.locked()))


def test_samples_of_other_shapes_stand_beside_each_other():
    found = swept(
        [-1.0, -2.0, -3.0],
        lambda run: np.zeros(2 + (gain(run) == -2.0)),
        executor="serial",
    )
    assert_array_equal(found["end"], [[0, 0, np.nan], [0, 0, 0], [0, 0, np.nan]])


FAILURES = {"hang": "timeout", "exit": "lost", "close": "lost", "raise": "failed"}
ORDERS = {"first": {-1.0}, "last": {-3.0}, "all": {-1.0, -2.0, -3.0}}


@pytest.mark.campaign
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("failure", FAILURES)
def test_no_order_of_failures_ends_a_sweep(failure, order):
    actions = {
        "hang": lambda: time.sleep(1e6),
        "exit": lambda: os._exit(3),
        "close": lambda: os.closerange(0, 99),
        "raise": lambda: 1 / 0,
    }

    def keep(run):
        if gain(run) in ORDERS[order]:
            actions[failure]()
        return end(run)

    gains = [-1.0, -2.0, -3.0]
    limit = None if failure != "hang" else 1.0 if order == "all" else LONG_LIMIT
    found = swept(gains, keep, workers=1, time_limit=limit)
    expected = [
        FAILURES[failure] if each in ORDERS[order] else "complete" for each in gains
    ]
    assert found["status"].values.tolist() == expected


@pytest.mark.parametrize("executor", ["serial", "threads"])
def test_a_sample_that_exits_fails_alone(executor):
    found = swept(
        [-1.0, -2.0],
        lambda run: sys.exit(3) if gain(run) == -1.0 else end(run),
        executor=executor,
    )
    assert found["status"].values.tolist() == ["failed", "complete"]
    assert found["message"].values[0] == "SystemExit: 3"
