"""Jobs that write files are killed at any instant: the next start works, and no temporary file stays.

Streamed logs have a test of their own.
"""

import contextlib
import itertools
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import campaign
import matplotlib.image
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose
from systems import series

from trussflow.blocks import Integrator, Ramp, Simulator, StateSpace
from trussflow.blocks.support.files import LOCK_SUFFIX, locked
from trussflow.blocks.tracing import compile_cache
from trussflow.fmu import Fmu, export
from trussflow.models.transport.__main__ import main

pytestmark = [
    pytest.mark.campaign,
    pytest.mark.skipif(os.name != "posix", reason="kill -9"),
]


def exports(k):
    """Write an FMU over the one before."""
    block = StateSpace(-np.eye(2), np.eye(2), (1.0 + k) * np.eye(2), np.zeros((2, 2)))
    export(block, "line.fmu", kind=("native", "python")[k % 2])


def compiles(k):
    diagram = series(ramp=Ramp([1.0] * (1 + k)), x=Integrator([0.0] * (1 + k)))
    result = Simulator(diagram, step=0.1, backend="compiled").run(1.0)
    assert_allclose(result["x.y"][-1], 0.5, rtol=1e-12)


def flies(_k):
    assert main(["--duration", "0.02", "--output", "out"]) == 0


JOBS = {exports: 2.0, compiles: 0.5, flies: 5.0}
"""What is killed, and until when [s]."""

KILLER = """
import itertools, json, os, sys, time
sys.path.insert(0, sys.argv[1])
import test_kills
for line in sys.stdin:
    job, calls, seconds, folder = json.loads(line)
    child = os.fork()
    if child:
        if seconds is not None:
            time.sleep(seconds)
            os.kill(child, 9)
        print("ended", os.waitpid(child, 0)[1], flush=True)
        continue
    os.chdir(folder)
    os.environ |= {"TMPDIR": f"{folder}/temporary", "TRUSSFLOW_CACHE": f"{folder}/cache"}
    said, sys.stdout = sys.stdout, open(os.devnull, "w")
    for k in calls or itertools.count():
        print(k, file=said, flush=True)
        getattr(test_kills, job)(k)
    sys.exit()
"""
"""Lets a fork do a job, again and again until it kills it, or so often: what takes long is imported once."""


READ = {
    ".fmu": lambda path: (zipfile.ZipFile(path).testzip(), Fmu(path, kind="cs")),
    ".png": matplotlib.image.imread,
    ".json": lambda path: json.loads(path.read_text()),
    ".nc": xr.load_dataset,
    ".html": lambda path: path.read_text(encoding="utf-8").rstrip().index("</html>"),
}
"""How files are read that whoever finds them takes for whole."""

KEPT = {*READ, ".so", ".o", ".key"}
"""Endings of what is kept."""


def left(folder):
    """Return files that should not be there, and temporary folders that no process holds."""
    for path in folder.rglob("*"):
        if path.name.endswith(LOCK_SUFFIX):
            with contextlib.suppress(BlockingIOError):
                locked(path).close()
                yield path
        elif "trussflow-" in path.name:
            if not path.with_suffix(LOCK_SUFFIX).exists():
                yield path
        elif (
            path.is_file()
            and path.suffix not in KEPT
            and "trussflow-" not in str(path.parent)
        ):
            yield path


@pytest.fixture(scope="module")
def forked():
    """Return what lets a job be done in a process of its own: calls begun, and the status at its end."""
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", KILLER, str(Path(__file__).parent)]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        told, said = process.stdin, process.stdout

        def do(job, folder, calls, seconds):
            print(json.dumps([job, calls, seconds, str(folder)]), file=told, flush=True)
            for begun in itertools.count():
                line = said.readline().split()
                if line[0] == "ended":
                    return begun, int(line[1])
            raise AssertionError

        yield do
        told.close()


@pytest.mark.parametrize("number", range(campaign.SIZE))
@pytest.mark.parametrize("job", JOBS)
def test_nothing_half_written_is_taken_for_whole_and_nothing_stays(
    job, number, forked, tmp_path
):
    (tmp_path / "temporary").mkdir()
    if job is flies:
        # compiling takes minutes
        (tmp_path / "cache").symlink_to(compile_cache.cache_folder())
    seconds = np.random.default_rng([campaign.SEED, number]).uniform(0.0, JOBS[job])
    begun, _ = forked(job.__name__, tmp_path, [], seconds)
    for path in itertools.chain(tmp_path.glob("*.*"), tmp_path.glob("out/*.*")):
        # A lock may stay until the next run removes it.
        if path.is_file() and not path.name.endswith(LOCK_SUFFIX):
            READ[path.suffix](path)
    last = max(0, begun - 1)
    # The second has something to write, also if the first was finished.
    assert forked(job.__name__, tmp_path, [last, last + 1], None) == (2, 0)
    assert list(left(tmp_path)) == []
