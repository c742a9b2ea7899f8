"""A Dask cluster of processes: a scheduler, three workers, and what is left when some of them are killed."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack

import pytest
import xarray as xr

from trussflow.__main__ import main
from trussflow.blocks.framework.command_arguments import thing_of

pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(os.name != "posix", reason="kill -9")

SWEEP_SCRIPT = """
import time
from functools import partial
from pathlib import Path
from scipy import stats
from trussflow.blocks import Diagram, Gain, Integrator, sweep

diagram = Diagram("decay")
x, back = diagram.add(x=Integrator(1.0), back=Gain(-1.0))
x >> back >> x

def keep(run):
    with open("{folder}/ran", "a") as file:
        file.write("x")
    time.sleep(0.02)
    return float(run["x.y"][-1])

vary = {{"back.gain": stats.norm(-1.0, 0.2)}}
campaign = partial(sweep, diagram, 1.0, vary=vary, samples=200, keep={{"end": keep}}, step=0.1)
"""


@pytest.fixture
def started(tmp_path):
    """Return what starts a part of Dask, until the test is over."""
    with ExitStack() as stack:

        def start(words):
            part, *more = words
            said = stack.enter_context((tmp_path / f"{part}.log").open("ab"))
            command = [
                sys.executable,
                "-m",
                f"distributed.cli.dask_{part}",
                *more,
                "--no-dashboard",
            ]
            process = subprocess.Popen(
                command, stdout=said, stderr=said, cwd=tmp_path, process_group=0
            )
            stack.callback(process.wait)
            stack.callback(os.killpg, process.pid, signal.SIGKILL)
            return process

        yield start


@pytest.fixture
def cluster(started, tmp_path):
    """Return the address of a scheduler with three workers, and the processes, the scheduler first."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    parts = [started(["scheduler", "--host", "127.0.0.1", "--port", str(port)])]
    parts += [
        started(["worker", address, "--nthreads", "1", "--no-nanny"]) for _ in range(3)
    ]
    (tmp_path / "script.py").write_text(SWEEP_SCRIPT.format(folder=tmp_path))
    return address, parts


def command(folder, *words):
    given = ["--path", f"{folder}/kept", "--output", f"{folder}/found.nc", *words]
    sweep = [
        sys.executable,
        "-m",
        "trussflow",
        "sweep",
        f"{folder}/script.py:campaign",
        *given,
    ]
    return subprocess.Popen(sweep, stderr=subprocess.PIPE)


def until(folder, samples):
    """Wait until so many have run."""
    deadline = time.monotonic() + 100.0
    while not (folder / "ran").exists() or (folder / "ran").stat().st_size < samples:
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.campaign
def test_a_worker_that_is_killed_is_not_noticed_in_the_dataset(cluster, tmp_path):
    address, parts = cluster
    with command(tmp_path, "--scheduler", address) as process:
        until(tmp_path, 50)
        os.killpg(parts[1].pid, signal.SIGKILL)
        assert process.wait(100) == 0
    campaign = thing_of(f"{tmp_path}/script.py:campaign")
    alone = campaign(executor="serial")
    xr.testing.assert_equal(xr.load_dataset(tmp_path / "found.nc"), alone)
    assert (alone["status"] == "complete").all()


@pytest.mark.campaign
def test_a_scheduler_that_is_killed_loses_nothing_that_is_finished(cluster, tmp_path):
    address, parts = cluster
    with command(tmp_path, "--scheduler", address) as process:
        until(tmp_path, 120)
        os.killpg(parts[0].pid, signal.SIGKILL)
        _, said = process.communicate(timeout=100)
    for part in parts[1:]:  # they may still be at what the scheduler had given them
        os.killpg(part.pid, signal.SIGKILL)
    assert process.returncode == 2
    assert b"error: the workers cannot go on: " in said, said.decode()
    # What workers have finished and the scheduler has not passed on dies with it: how much, depends.
    kept = re.search(
        rb"; (\d+) of 200 samples are finished and kept: the same call goes on with the others",
        said,
    )
    before = (tmp_path / "ran").stat().st_size
    assert (
        main(["sweep", f"{tmp_path}/script.py:campaign", "--path", f"{tmp_path}/kept"])
        == 0
    )
    assert (tmp_path / "ran").stat().st_size - before == 200 - int(kept[1])


def test_there_may_be_no_scheduler(tmp_path, capsys):
    (tmp_path / "script.py").write_text(SWEEP_SCRIPT.format(folder=tmp_path))
    assert (
        main(["sweep", f"{tmp_path}/script.py:campaign", "--scheduler", "127.0.0.1:9"])
        == 2
    )
    assert "there is no scheduler at '127.0.0.1:9'" in capsys.readouterr().err
