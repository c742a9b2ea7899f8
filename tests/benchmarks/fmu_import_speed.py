"""Cost of our wrapper around an imported FMU, for ``run.py``: our step beside the bare C calls."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
from bare_fmu import BareFmu
from table import Row

from trussflow.blocks import Diagram, Simulator
from trussflow.fmu import Fmu, export
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.models import SpaceTruss

REPETITIONS = 15
STEPS = 1000


def per_step(job):
    """Return the time that this thread spends on one of the steps that a job makes [s]."""
    started = time.thread_time()
    job()
    return (time.thread_time() - started) / STEPS


def imported_fmu(folder, open_until_end):
    """Return what measures a step of co-simulation with 52 inputs and 80 outputs."""
    plant = Diagram("plant")
    truss = plant.add(truss=SpaceTruss.consistent())
    plant.expose(force=truss.actuation, q=truss.coordinates, u=truss.speeds)
    path = export(plant, folder / "imported.fmu")
    bare = BareFmu(path, ("q", "u"))
    slave = open_until_end.enter_context(LoadedCoSimulation(path))
    slave.setup()
    force, outputs = np.full(slave.input_values.size, 0.1), slave.get_outputs()
    assert len(bare.given) + len(bare.taken) == force.size + outputs.size == 132
    clock = 0

    def by_c():
        for _ in range(STEPS):
            bare.write()
            bare.step()
            bare.read()

    def by_us():
        nonlocal clock
        for _ in range(STEPS):
            slave.set_inputs(force)
            slave.do_step(clock * 1e-3, 1e-3)
            slave.get_outputs()
            clock += 1

    diagram = Diagram("loop")
    fmu = diagram.add(fmu=Fmu(path, kind="cs", step=1e-3))
    diagram.ground(fmu.force)
    simulator = Simulator(diagram, step=1e-3, log=["fmu.q"], log_step=1.0)
    as_block = partial(simulator.run, STEPS * 1e-3, progress=False)
    as_block()

    def measure():
        times = np.array(
            [
                (per_step(by_us), per_step(as_block), per_step(by_c))
                for _ in range(REPETITIONS)
            ]
        )
        ours, block, c = np.median(times, axis=0)
        ratios = np.median(times[:, :2] / times[:, 2:], axis=0)
        name = "the same FMU as a block in a diagram, a step / bare C calls"
        return [
            Row.of(
                "imported FMU, a step: ours / bare C calls", ours, c, float(ratios[0])
            ),
            Row.of(name, block, c, float(ratios[1])),
        ]

    return measure
