"""Speed of the plant as a native FMU, for ``run.py``: raw calls of the C functions."""

from __future__ import annotations

import ctypes
import os
import statistics
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from trussflow.blocks import Diagram, Simulator
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.export import export
from trussflow.models import SpaceTruss

REPETITIONS = 15
Row = tuple[str, str, str]


def best(job: Callable[[], object], calls: int) -> float:
    """Return the least wall time of one of the calls that a job makes [s]."""
    times = []
    for _ in range(REPETITIONS):
        started = time.perf_counter()
        job()
        times.append((time.perf_counter() - started) / calls)
    return min(times)


def native_fmu() -> list[Row]:
    """Measure export, steps, and set and get of the plant."""
    with tempfile.TemporaryDirectory() as folder:
        kept = os.environ.get("TRUSSFLOW_CACHE")
        os.environ["TRUSSFLOW_CACHE"] = folder  # so that nothing is compiled already
        started = time.perf_counter()
        path = export(SpaceTruss.consistent(), Path(folder) / "plant.fmu")
        exporting = time.perf_counter() - started
        if kept is None:
            del os.environ["TRUSSFLOW_CACHE"]
        else:
            os.environ["TRUSSFLOW_CACHE"] = kept
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        size = path.stat().st_size / 1e6
        return [
            ("export of the plant for one platform", f"{exporting:.1f} s", "<= 30 s"),
            ("the plant's FMU with its sources", f"{size:.2f} MB", "<= 2 MB"),
            *_calls(Path(folder), fmpy.read_model_description(str(path)).guid),
        ]


def _calls(folder: Path, guid: str) -> list[Row]:
    """Measure calls without any wrapper of Python in between."""
    plant = SpaceTruss.consistent()
    interface = ExportInterface.of(plant)
    binary = next(f for f in (folder / "binaries").rglob("*") if f.is_file())
    library = ctypes.CDLL(str(binary))
    library.fmi2Instantiate.restype = ctypes.c_void_p
    c = ctypes.c_void_p(library.fmi2Instantiate(b"one", 1, guid.encode(), b"", (ctypes.c_void_p * 5)(), 0, 0))
    number = ctypes.c_double
    library.fmi2SetupExperiment(c, 0, number(0), number(0), 0, number(0))
    library.fmi2EnterInitializationMode(c)
    library.fmi2ExitInitializationMode(c)

    def array(kind: Any, values: Any) -> Any:
        return (kind * len(values))(*values)

    places = {v.name: v for v in interface.variables}
    given = array(ctypes.c_uint, [*places["actuation"].references])
    taken = array(ctypes.c_uint, [*places["coordinates"].references, *places["speeds"].references])
    force, result = array(number, [0.1] * 52), array(number, [0.0] * 80)
    steps, h = 300, number(1e-3)
    clock = 0

    def stepping() -> None:
        nonlocal clock
        for _ in range(steps):
            library.fmi2DoStep(c, number(clock * 1e-3), h, 1)
            clock += 1

    def exchanging() -> None:
        for _ in range(steps):
            library.fmi2SetReal(c, given, 52, force)
            library.fmi2GetReal(c, taken, 80, result)

    def nothing() -> None:
        for _ in range(steps):
            library.fmi2SetReal(c, given, 0, force)
            library.fmi2GetReal(c, taken, 0, result)

    diagram = Diagram("plant")
    diagram.add(truss=plant)
    diagram.ground(plant.actuation)
    simulator = Simulator(diagram, step=1e-3, log=["truss.modal_rate"], log_step=1.0)

    def in_process() -> None:
        simulator.run(steps * 1e-3, progress=False)

    evaluations = 20_000
    rhs = right_hand_sides(simulator, evaluations)
    ratios, pairs = [], []
    for _ in range(REPETITIONS):
        a, b = best(stepping, steps), best(rhs, evaluations)
        ratios.append(a / (4 * b))
        pairs.append((a, 4 * b))
    a, b = np.median(pairs, axis=0)
    exchange = best(exchanging, steps) - best(nothing, steps)
    one = best(in_process, steps)
    return [
        (
            "doStep of 1 ms / four compiled right-hand sides",
            f"{a * 1e6:.1f} us / {b * 1e6:.1f} us = {statistics.median(ratios):.2f}",
            "<= 1.5",
        ),
        ("set and get of 132 scalars, raw", f"{exchange * 1e6:.2f} us", "<= 2 us"),
        ("one RK4 step in the process, for comparison", f"{one * 1e6:.1f} us", ""),
    ]


def right_hand_sides(simulator: Simulator, number: int) -> Callable[[], object]:
    """Return a job that evaluates compiled right-hand sides, with the flags of this machine.

    They are Euler steps, which are one evaluation each, in the loop of the library.
    """
    root = simulator.prepared.plan.system.root
    assert isinstance(root, Diagram)
    log = ["truss.modal_rate"]
    euler = Simulator(root, step=1e-6, solver="euler", log=log, log_step=1e-6 * number)
    return lambda: euler.run(1e-6 * number, progress=False)
