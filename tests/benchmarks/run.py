"""``make bench``: speed as ratios measured in one process, medians of interleaved repetitions."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import loops
import numpy as np
import pinocchio as pin
import pinocchio_tree
from fmu_import_speed import imported_fmu
from fmu_speed import native_fmu

from trussflow.blocks import Diagram, Linearizer, Simulator
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

REPETITIONS = 9
STEPS = 60_000

FIRST_STEP = """
import os
from trussflow.blocks import Simulator
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram
from trussflow.models.transport.logged_ports import logged
diagram = transport_diagram(Mission.of_case(1), SpaceTruss.published())
simulator = Simulator(diagram, step=1e-3, log=logged(diagram), log_step=1e-2)
simulator.executor.advance = lambda *_: os._exit(0)  # the first step would start now
simulator.run(1.0)
"""


def elapsed(job: Callable[[], object]) -> float:
    """Return the wall time of one call [s]."""
    started = time.perf_counter()
    job()
    return time.perf_counter() - started


def paired(ours: Callable[[], object], theirs: Callable[[], object]) -> tuple[float, float, float]:
    """Return the median times of two jobs run in turn [s], and the median of their ratios."""
    ours(), theirs()
    times = np.array([(elapsed(ours), elapsed(theirs)) for _ in range(REPETITIONS)])
    return (*np.median(times, axis=0), float(np.median(times[:, 0] / times[:, 1])))


def forward_dynamics() -> tuple[str, str, str]:
    """Compare one evaluation of the flexible plant with Pinocchio's ABA on the rigid tree."""
    plant = SpaceTruss.consistent()
    diagram = Diagram("plant")
    diagram.add(truss=plant)
    diagram.ground(plant.actuation)
    simulator = Simulator(diagram, step=1e-3, log=["truss.modal_rate"], log_step=1.0)
    speeds = np.random.default_rng(0).standard_normal(plant.n) * 0.01
    model = pinocchio_tree.rigid_tree()
    data, q = model.createData(), pin.neutral(model)
    v = tau = np.random.default_rng(0).standard_normal(model.nv)

    def ours() -> None:
        simulator.run(1.0, initial={"truss.v": speeds}, progress=False)

    def theirs() -> None:
        for _ in range(4000):
            pin.aba(model, data, q, v, tau)

    a, b, ratio = paired(ours, theirs)
    name = "flexible 40-DOF forward dynamics / Pinocchio aba, rigid 34"
    return name, f"{a / 4000 * 1e6:.2f} us / {b / 4000 * 1e6:.2f} us = {ratio:.2f}", "<= 0.6"


def closed_loop() -> tuple[str, str, str]:
    """Measure Case 1 against the clock."""
    diagram = transport_diagram(Mission.of_case(1), SpaceTruss.published())
    log = ["controller.error", "truss.base_force", "truss.base_torque"]
    simulator = Simulator(diagram, step=1e-3, log=log, log_step=0.01)
    wall = float(np.median([elapsed(lambda: simulator.run(80.0, progress=False)) for _ in range(3)]))
    return "Case 1 closed loop, 80 s, RK4 at 1 ms", f"{80 / wall:.0f} x real time", ">= 20 x"


def overhead() -> list[tuple[str, str, str]]:
    """Compare loops of two user-written blocks with the same loops by hand in numba."""
    stiffness, damping = loops.chain_matrices()
    small = Simulator(loops.loop(loops.Oscillator(), ()), step=loops.STEP)
    large = Simulator(loops.loop(loops.Chain(stiffness, damping), (40,)), step=loops.STEP)
    end = STEPS * loops.STEP
    jobs = [
        (
            "80 states, two blocks (job B) / numba by hand",
            "<= 1.3",
            large,
            lambda: loops.chain_by_hand(STEPS, loops.STEP, stiffness, damping),
        ),
        (
            "2 states, two blocks (job A) / numba by hand",
            "<= 5",
            small,
            lambda: loops.oscillator_by_hand(STEPS, loops.STEP),
        ),
    ]
    rows = []
    for name, target, simulator, by_hand in jobs:
        a, b, ratio = paired(partial(simulator.run, end, progress=False), by_hand)
        figure = f"{a / STEPS * 1e9:.0f} ns / {b / STEPS * 1e9:.0f} ns = {ratio:.2f}"
        rows.append((name, figure, target))
    return rows


def first_step() -> list[tuple[str, str, str]]:
    """Measure whole processes up to the first steps of Case 1, nothing cached and cached."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"TRUSSFLOW_CACHE": cache}
        command = [sys.executable, "-c", FIRST_STEP]

        def job() -> None:
            subprocess.run(command, env=environment, check=True)

        cold = elapsed(job)
        warm = float(np.median([elapsed(job) for _ in range(3)]))
    return [
        ("first run of Case 1 before the first step, nothing cached", f"{cold:.1f} s", "<= 20 s"),
        ("the same, cached", f"{warm:.1f} s", "<= 2 s"),
    ]


def linearization() -> tuple[str, str, str]:
    """Measure the exact linearization of the plant: 80 states, 52 inputs, all outputs."""
    linearizer = Linearizer(SpaceTruss.consistent())
    linearizer.at()
    wall = float(np.median([elapsed(linearizer.at) for _ in range(REPETITIONS)]))
    name = "exact linearization of the plant, 80 states, 52 inputs, once set up"
    return name, f"{1e3 * wall:.0f} ms", "<= 100 ms"


def main() -> None:
    """Run all benchmarks and print the table."""
    rows = [forward_dynamics(), closed_loop(), linearization(), *overhead(), *first_step()]
    rows += [*native_fmu(), *imported_fmu()]
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    for row in [("what", "median", "target"), *rows]:
        print("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip())


if __name__ == "__main__":
    main()
