"""Speed of the plant as a native FMU, for ``run.py``: raw calls of the C functions."""

from __future__ import annotations

import statistics
import time

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


def native_fmu(folder):
    """Return what measures steps of the plant."""
    plant = SpaceTruss.consistent()
    fmu = BareFmu(export(plant, folder / "native.fmu"), ())

    def stepping():
        for _ in range(STEPS):
            fmu.step()

    diagram = Diagram("plant")
    diagram.add(truss=plant)
    diagram.ground(plant.actuation)
    # Euler steps are one evaluation each, in the loop of the library, with the flags of this machine.
    euler = Simulator(
        diagram,
        step=1e-6,
        solver="euler",
        log=["truss.modal_rate"],
        log_step=1e-6 * EVALUATIONS,
    )

    def right_hand_sides():
        euler.run(1e-6 * EVALUATIONS, progress=False)

    def measure():
        pairs = [
            (best(stepping, STEPS), 4 * best(right_hand_sides, EVALUATIONS))
            for _ in range(REPETITIONS)
        ]
        a, b = np.median(pairs, axis=0)
        ratio = statistics.median(ours / theirs for ours, theirs in pairs)
        name = "doStep of 1 ms / four compiled right-hand sides"
        return [Row.of(name, a, b, ratio)]

    return measure
