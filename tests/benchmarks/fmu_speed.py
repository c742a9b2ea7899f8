"""Speed of the plant as a native FMU, for ``run.py``: raw calls of the C functions."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from bare_fmu import BareFmu
from table import Row

from trussflow.blocks import Diagram, Simulator
from trussflow.fmu import export
from trussflow.models import SpaceTruss

REPETITIONS = 15
STEPS = 300
EVALUATIONS = 20_000


def best(job, calls):
    """Return the least wall time of one of the calls that a job makes [s]."""
    times = []
    for _ in range(REPETITIONS):
        started = time.perf_counter()
        job()
        times.append((time.perf_counter() - started) / calls)
    return min(times)


def exporting():
    """Measure export of the plant, with nothing compiled already."""
    with tempfile.TemporaryDirectory() as folder:
        kept = os.environ.get("TRUSSFLOW_CACHE")
        os.environ["TRUSSFLOW_CACHE"] = folder
        started = time.perf_counter()
        path = export(SpaceTruss.consistent(), Path(folder) / "plant.fmu")
        wall = time.perf_counter() - started
        if kept is None:
            del os.environ["TRUSSFLOW_CACHE"]
        else:
            os.environ["TRUSSFLOW_CACHE"] = kept
        size = path.stat().st_size / 1e6
    return [
        Row("export of the plant for one platform", f"{wall:.1f} s", "<= 30 s"),
        Row("the plant's FMU with its sources", f"{size:.2f} MB", "<= 2 MB"),
    ]


def native_fmu(folder):
    """Return what measures steps, and set and get, of the plant."""
    plant = SpaceTruss.consistent()
    fmu = BareFmu(export(plant, folder / "native.fmu"), ("coordinates", "speeds"))
    assert len(fmu.given) + len(fmu.taken) == 132

    def stepping():
        for _ in range(STEPS):
            fmu.step()

    def exchanging():
        for _ in range(STEPS):
            fmu.write()
            fmu.read()

    def nothing():
        for _ in range(STEPS):
            fmu.write(0)
            fmu.read(0)

    diagram = Diagram("plant")
    diagram.add(truss=plant)
    diagram.ground(plant.actuation)
    log = ["truss.modal_rate"]
    simulator = Simulator(diagram, step=1e-3, log=log, log_step=1.0)
    # Euler steps are one evaluation each, in the loop of the library, with the flags of this machine.
    euler = Simulator(
        diagram, step=1e-6, solver="euler", log=log, log_step=1e-6 * EVALUATIONS
    )

    def in_process():
        simulator.run(STEPS * 1e-3, progress=False)

    def right_hand_sides():
        euler.run(1e-6 * EVALUATIONS, progress=False)

    def measure():
        pairs = [
            (best(stepping, STEPS), 4 * best(right_hand_sides, EVALUATIONS))
            for _ in range(REPETITIONS)
        ]
        a, b = np.median(pairs, axis=0)
        ratio = statistics.median(ours / theirs for ours, theirs in pairs)
        exchange = best(exchanging, STEPS) - best(nothing, STEPS)
        one = best(in_process, STEPS)
        return [
            Row.of("doStep of 1 ms / four compiled right-hand sides", a, b, ratio),
            Row(
                "set and get of 132 scalars, raw", f"{exchange * 1e6:.2f} us", "<= 2 us"
            ),
            Row("one RK4 step in the process, for comparison", f"{one * 1e6:.1f} us"),
        ]

    return measure
