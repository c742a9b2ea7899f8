"""A Dask cluster of processes: a scheduler, three workers, and what is left when some of them are killed."""

import os
import re
import runpy
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack

import pytest
import xarray as xr

pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(os.name != "posix", reason="kill -9")

SWEEP_SCRIPT = """
import time
import sys
from functools import partial
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

if __name__ == "__main__":
    from distributed import Client
    client = Client(sys.argv[1])
    found = campaign(executor=client.get_executor(), workers=3, path="{folder}/kept")
    found.to_netcdf("{folder}/found.nc")
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


def started_sweep(folder, address):
    words = [sys.executable, f"{folder}/script.py", address]
    return subprocess.Popen(words, stderr=subprocess.PIPE)


def campaign_of(folder):
    return runpy.run_path(f"{folder}/script.py")["campaign"]


def until(folder, samples):
    """Wait until so many have run."""
    deadline = time.monotonic() + 100.0
    while not (folder / "ran").exists() or (folder / "ran").stat().st_size < samples:
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.campaign
def test_a_worker_that_is_killed_is_not_noticed_in_the_dataset(cluster, tmp_path):
    address, parts = cluster
    with started_sweep(tmp_path, address) as process:
        until(tmp_path, 50)
        os.killpg(parts[1].pid, signal.SIGKILL)
        assert process.wait(100) == 0
    alone = campaign_of(tmp_path)(executor="serial")
    xr.testing.assert_equal(xr.load_dataset(tmp_path / "found.nc"), alone)
    assert (alone["status"] == "complete").all()


@pytest.mark.campaign
def test_a_scheduler_that_is_killed_loses_nothing_that_is_finished(cluster, tmp_path):
    address, parts = cluster
    with started_sweep(tmp_path, address) as process:
        until(tmp_path, 120)
        os.killpg(parts[0].pid, signal.SIGKILL)
        _, said = process.communicate(timeout=100)
    for part in parts[1:]:  # they may still be at what the scheduler had given them
        os.killpg(part.pid, signal.SIGKILL)
    assert process.returncode == 1
    assert b"the workers cannot continue: " in said, said.decode()
    # What workers have finished and the scheduler has not passed on dies with it: how much, depends.
    kept = re.search(
        rb"; (\d+) of 200 samples are finished and kept: the same call continues with the others",
        said,
    )
    before = (tmp_path / "ran").stat().st_size
    campaign_of(tmp_path)(executor="serial", path=f"{tmp_path}/kept")
    assert (tmp_path / "ran").stat().st_size - before == 200 - int(kept[1])
