"""Cost of our wrapper around an imported FMU, for ``run.py``: our step less the bare C calls."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from trussflow.blocks import Diagram, Simulator
from trussflow.fmu import Fmu, export
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.models import SpaceTruss

REPETITIONS = 15
STEPS = 1000
Row = tuple[str, str, str]


def per_step(step: Callable[[int], object]) -> float:
    """Return the time that this thread spends on one step [s]."""
    started = time.thread_time()
    for k in range(STEPS):
        step(k)
    return (time.thread_time() - started) / STEPS


def imported_fmu() -> list[Row]:
    """Measure a step of co-simulation with 52 inputs and 80 outputs."""
    plant = Diagram("plant")
    truss = plant.add(truss=SpaceTruss.consistent())
    plant.expose(force=truss.actuation, q=truss.coordinates, u=truss.speeds)
    with tempfile.TemporaryDirectory() as folder:
        path = export(plant, Path(folder) / "plant.fmu")
        with LoadedCoSimulation(path) as slave:
            wrapper = _wrapper(slave)
        diagram = Diagram("loop")
        fmu = diagram.add(fmu=Fmu(path, kind="cs", step=1e-3))
        diagram.ground(fmu.force)
        simulator = Simulator(diagram, step=1e-3, log=["fmu.q"], log_step=1.0)
        whole = partial(simulator.run, STEPS * 1e-3, progress=False)
        whole()
        times = []
        for _ in range(3):
            started = time.thread_time()
            whole()
            times.append((time.thread_time() - started) / STEPS)
    return [*wrapper, ("the same FMU as a block in a diagram, a step", f"{min(times) * 1e6:.1f} us", "")]


def _wrapper(slave: LoadedCoSimulation) -> list[Row]:
    """Compare our step with the same three functions of the FMU called bare."""
    slave.setup()
    force, outputs = np.full(slave.input_values.size, 0.1), np.zeros(slave.output_values.size)
    assert force.size + outputs.size == 132
    library, clock = slave._library, 0
    do_step, component = library.function("DoStep"), library.component
    write, read = slave._input._call, slave._output._call

    def bare(_: int) -> None:
        nonlocal clock
        write()
        do_step(component, clock * 1e-3, 1e-3, 1)
        read()
        clock += 1

    def ours(_: int) -> None:
        nonlocal clock
        slave.set_inputs(force)
        slave.do_step(clock * 1e-3, 1e-3)
        slave.get_outputs(outputs)
        clock += 1

    pairs = [(per_step(ours), per_step(bare)) for _ in range(REPETITIONS)]
    a, b = np.median(pairs, axis=0)
    difference = float(np.median([x - y for x, y in pairs]))
    return [
        ("imported FMU, a step: ours / bare C calls", f"{a * 1e6:.1f} us / {b * 1e6:.1f} us", ""),
        ("our part of it, 132 scalars", f"{difference * 1e6:.2f} us", "<= 2 us"),
    ]
