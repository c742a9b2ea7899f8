"""``make bench``: speed as ratios measured in one process, medians of interleaved repetitions.

``make bench-check`` measures the ratios alone and fails if one is far above its target; both are in
``table.py``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import loops
import numpy as np
import pinocchio as pin
import small_sweep
from fmu_import_speed import imported_fmu
from fmu_speed import native_fmu
from hybrid_models import HYBRIDS, by_hand
from table import Row, check, show

from trussflow.blocks import Diagram, Simulator
from trussflow.blocks.simulation.lanes import Lanes, Points
from trussflow.blocks.tracing.compiler import lanes
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

REPETITIONS = 9
STEPS = 60_000

FIRST_STEP = """
import os
from trussflow.blocks import Simulator
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram
from trussflow.models.transport.results import logged
diagram = transport_diagram(Mission.of_case(1), SpaceTruss.published())
simulator = Simulator(diagram, step=1e-3, log=logged(diagram), log_step=1e-2)
simulator.run(1e-3, progress=False)
os._exit(0)  # how long Python takes to tidy up is not the question
"""


def elapsed(job):
    """Return the wall time of one call [s]."""
    started = time.perf_counter()
    job()
    return time.perf_counter() - started


def paired(ours, theirs, repetitions=REPETITIONS):
    """Return the median times of two jobs run in turn [s], and the median of their ratios."""
    ours(), theirs()
    times = np.array([(elapsed(ours), elapsed(theirs)) for _ in range(repetitions)])
    return (*np.median(times, axis=0), float(np.median(times[:, 0] / times[:, 1])))


def rigid_tree():
    """Return a floating body with four arms of seven revolute joints: 34 degrees of freedom."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "truss")
    model.appendBodyToJoint(root, pin.Inertia.Random(), pin.SE3.Identity())
    for robot in range(4):
        parent = root
        for joint in range(7):
            name = f"robot {robot} joint {joint}"
            parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Random(), name)
            model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
    return model


def forward_dynamics():
    """Compare one evaluation of the flexible plant with Pinocchio's ABA on the rigid tree."""
    plant = SpaceTruss.consistent()
    diagram = Diagram("plant")
    diagram.add(truss=plant)
    diagram.ground(plant.actuation)
    simulator = Simulator(diagram, step=1e-3, log=["truss.modal_rate"], log_step=1.0)
    speeds = np.random.default_rng(0).standard_normal(plant.n) * 0.01
    model = rigid_tree()
    data, q = model.createData(), pin.neutral(model)
    v = tau = np.random.default_rng(0).standard_normal(model.nv)
    evaluations = 40_000  # beginning a run takes as long as 1000

    def ours():
        simulator.run(
            evaluations / 4 * 1e-3, initial={"truss.v": speeds}, progress=False
        )

    def theirs():
        for _ in range(evaluations):
            pin.aba(model, data, q, v, tau)

    def measure():
        a, b, ratio = paired(ours, theirs)
        name = "flexible 40-DOF forward dynamics / Pinocchio aba, rigid 34"
        return [Row.of(name, a / evaluations, b / evaluations, ratio)]

    return measure


def closed_loop():
    """Measure Case 1 against the clock."""
    diagram = transport_diagram(Mission.of_case(1), SpaceTruss.published())
    log = ["controller.error", "truss.base_force", "truss.base_torque"]
    simulator = Simulator(diagram, step=1e-3, log=log, log_step=0.01)
    run = partial(simulator.run, 80.0, progress=False)
    wall = float(np.median([elapsed(run) for _ in range(4)][1:]))
    name = "Case 1 closed loop, 80 s, RK4 at 1 ms"
    return [Row(name, f"{80 / wall:.0f} x real time", ">= 20 x")]


def overhead():
    """Compare loops of two user-written blocks with the same loops by hand in numba."""
    stiffness, damping = loops.chain_matrices()
    small = Simulator(loops.loop(loops.Oscillator(), ()), step=loops.STEP)
    large = Simulator(
        loops.loop(loops.Chain(stiffness, damping), (40,)), step=loops.STEP
    )
    jobs = {
        "80 states, two blocks (job B) / numba by hand": (
            large,
            partial(loops.chain_by_hand, STEPS, loops.STEP, stiffness, damping),
        ),
        "2 states, two blocks (job A) / numba by hand": (
            small,
            partial(loops.oscillator_by_hand, STEPS, loops.STEP),
        ),
    }

    def measure():
        rows = []
        for name, (simulator, in_numba) in jobs.items():
            ours = partial(simulator.run, STEPS * loops.STEP, progress=False)
            a, b, ratio = paired(ours, in_numba)
            rows.append(Row.of(name, a / STEPS, b / STEPS, ratio, per=1e-9))
        return rows

    return measure


def side_by_side():
    """Compare samples of a sweep that are advanced at once on one core with the same one by one."""
    diagram = loops.loop(loops.Chain(*loops.chain_matrices()), (40,))
    simulator = Simulator(diagram, step=loops.STEP, log_step=100 * loops.STEP)
    duration = STEPS / 10 * loops.STEP
    plan, count = simulator.prepared.plan, lanes()
    p = plan.parameters(None)
    points = Points(*(np.tile(v, (count, 1)) for v in (*plan.initial(p, None), p)))
    batch = Lanes(simulator, count)

    def together():
        return [*batch.run(duration, points, "stop")]

    def alone():
        for _ in range(count):
            simulator.run(duration, progress=False)

    def measure():
        a, b, ratio = paired(together, alone)
        return [
            Row.of(
                "80 states (job B), samples at once on one core / alone", a, b, ratio
            )
        ]

    return measure


def small():
    """Compare a sweep of many short runs with a loop by hand."""

    def measure():
        a, b, ratio = paired(small_sweep.swept, small_sweep.by_hand)
        name = "10,000 samples of 500 steps of three states / numba by hand"
        return [Row.of(name, a, b, ratio)]

    return measure


def hybrid():
    """Compare an engine with events with SciPy's integrator called from event to event."""
    engine = HYBRIDS["engine"]
    simulator = Simulator(engine.diagram, step=engine.step)

    def measure():
        ours = partial(simulator.run, engine.duration, progress=False)
        a, b, ratio = paired(ours, by_hand(engine))
        name = "engine with 300 sparks, RK4 at 1 ms / SciPy from event to event"
        return [Row.of(name, a, b, ratio)]

    return measure


def first_step():
    """Measure whole processes up to the first step of Case 1, nothing cached and cached."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"TRUSSFLOW_CACHE": cache}
        command = [sys.executable, "-c", FIRST_STEP]

        def job():
            subprocess.run(command, env=environment, check=True)

        cold = elapsed(job)
        warm = float(np.median([elapsed(job) for _ in range(3)]))
    return [
        Row(
            "first run of Case 1 up to its first step, nothing cached",
            f"{cold:.1f} s",
            "<= 20 s",
        ),
        Row("the same, cached", f"{warm:.1f} s", "<= 2 s"),
    ]


def main():
    """Run all benchmarks and print the table, or check those that are ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--check",
        action="store_true",
        help="measure the ratios, fail if one is too slow",
    )
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        checking = parser.parse_args().check
        ratios = [forward_dynamics(), overhead(), side_by_side(), small(), hybrid()]
        ratios += [native_fmu(folder), imported_fmu(folder, stack)]
        if checking:
            return check(ratios)
        others = [closed_loop, first_step]
        show([row for benchmark in [*ratios, *others] for row in benchmark()])
    return 0


if __name__ == "__main__":
    sys.exit(main())
