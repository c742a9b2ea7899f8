"""``make bench-growth``: how the cost of the equations grows with robots and modes, beside Pinocchio's.

Compiling takes minutes where there are 60 modes, but for the first time only.
"""

from __future__ import annotations

import os
import time
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin
from pinocchio_tree import rigid_tree
from table import Row, show

from trussflow.blocks import Diagram, Simulator
from trussflow.models import Frame, RobotArm, SpaceTruss, TrussDynamics, reduced_modes

ROBOTS, MODES = (1, 2, 4, 8), (0, 20, 60)
RING = Path(__file__).parents[2] / "examples" / "missions" / "ring.toml"
STEP = 1e-6
"""So short that no mode makes it unstable; how long a step takes is the same [s]."""

REPETITIONS, EVALUATIONS = 9, 2000


def ring(robots, modes):
    """Return a ring of so many modes with so many arms of seven joints."""
    structure = Frame.from_file(RING).structure()
    flexible = reduced_modes(
        structure, modes, list(range(1, robots + 1)), attachments=False
    )
    arms = (RobotArm.literal(),) * robots
    return SpaceTruss(TrussDynamics(modes=flexible, arms=arms, elastic_integrals=True))


def compared(robots, modes):
    """Compare one evaluation of the flexible ring with Pinocchio's ABA on a rigid tree of as many arms."""
    plant = ring(robots, modes)
    diagram = Diagram("ring")
    diagram.add(truss=plant)
    diagram.ground(plant.actuation)
    simulator = Simulator(diagram, step=STEP, log=["truss.rigid_speeds"], log_step=1.0)
    speeds = 0.01 * np.random.default_rng(0).standard_normal(plant.n)
    model = rigid_tree(robots)
    data, q = model.createData(), pin.neutral(model)
    v = np.random.default_rng(0).standard_normal(model.nv)
    run = partial(
        simulator.run,
        EVALUATIONS / 4 * STEP,
        initial={"truss.v": speeds},
        progress=False,
    )
    run()
    times = []
    for _ in range(REPETITIONS):
        started = time.perf_counter()
        run()
        between = time.perf_counter()
        for _ in range(EVALUATIONS):
            pin.aba(model, data, q, v, v)
        times.append((between - started, time.perf_counter() - between))
    ours, theirs = 1e6 * np.median(times, axis=0) / EVALUATIONS
    ratio = np.median([a / b for a, b in times])
    figure = f"{ours:.3g} us / {theirs:.3g} us = {ratio:.2f}"
    return Row(
        f"{robots} robots, {modes} modes / Pinocchio aba, rigid {6 + 7 * robots}",
        figure,
    )


if __name__ == "__main__":
    show([compared(robots, modes) for modes in MODES for robots in ROBOTS])
