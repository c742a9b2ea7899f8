"""Random diagrams of library blocks run alike on all backends, or are refused by one of our errors.

Alike is also where a run stops because something is not finite: at the same block and time. Only where
CasADi simplifies u/u to 1 and 0*u to 0 before it evaluates may that differ; without that, it may not.

The campaign draws more diagrams. Every twentieth is compiled as well.
"""

import random
import re
import warnings
from collections import Counter
from contextlib import contextmanager
from time import monotonic

import campaign
import casadi as ca
import numpy as np
import pytest
import xarray as xr
from random_diagrams import build
from systems import assert_near

from trussflow.blocks import Session, Simulator
from trussflow.blocks.errors import DivergenceError, TrussflowError
from trussflow.blocks.framework.system import flatten

DIAGRAM_COUNT = 30 * campaign.SIZE
parts = pytest.mark.parametrize("part", [0, *map(campaign.only, range(1, 4))])

TIME_LIMIT = 10.0
"""For a diagram on one backend [s]."""

ROUND_OFF = 1e-9
"""Relative to the largest number of a signal: round-off of other orders of the same operations."""


FAULT = re.compile(r"('[^']*'(?:\[\d+\])?.* stopped being finite at t = \S+ s)")


def run(diagram, seed, backend):
    """Return how a run went, that is which error of ours stopped it if any, and what it logged."""
    r = random.Random(seed)
    solver, step = r.choice(["rk4", "rk4", "euler"]), r.choice([0.05, 0.05, 0.05, 0.1])
    started = monotonic()
    diverged = None
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            simulator = Simulator(diagram, step=step, solver=solver, backend=backend)
            how, result = "ran", simulator.run(0.5, not_finite="stop")
    except DivergenceError as error:
        diverged = error
    except TrussflowError as error:
        how, result = type(error).__name__, xr.Dataset()
    assert monotonic() - started < TIME_LIMIT
    if diverged is not None:
        fault = FAULT.match(str(diverged))
        assert fault is not None, diverged
        assert isinstance(diverged.result, xr.Dataset)
        how, result = re.sub(r", and \d+ others", "", fault[1]), diverged.result
    return how, {str(name): values.values for name, values in result.items()}


@contextmanager
def nothing_simplified():
    """Let CasADi compute what is written, 0/0 included."""
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(True)


def place(how):
    """Return block and time of what stopped being finite."""
    return re.findall(r"^'(\w+)\.|at (t = \S+ s)", how)


def check(seed):
    """Run the diagram of a seed on several backends; return how it went."""
    diagram = build(seed)
    expected, signals = run(diagram, seed, "numpy")
    kind = "stopped" if "finite" in expected else expected
    for backend in ["interpreted", "compiled"] if seed % 20 == 0 else ["interpreted"]:
        how, found = run(diagram, seed, backend)
        if how != expected and "stopped" in kind:
            kind = "stopped, simplified"
            with nothing_simplified():
                how, found = run(build(seed), seed, backend)
            if how == "AlgebraicLoopError":
                continue  # not simplified, 0*u depends on u
        if kind == "stopped, simplified" and place(how) == place(expected):
            continue  # a zero of a matrix times infinity: of the same block state or output is named
        assert how == expected, f"{expected} on numpy, {how} on {backend}"
        for name, values in signals.items():
            scale = max(1.0, np.abs(values[np.isfinite(values)]).max(initial=0.0))
            assert_near(
                found[name], values, ROUND_OFF * scale, err_msg=f"{name} on {backend}"
            )
    return kind


def seeds(part):
    first = campaign.SEED + part * DIAGRAM_COUNT
    return range(first, first + DIAGRAM_COUNT)


@parts
def test_random_diagrams_run_alike_or_are_refused(part):
    found = Counter[str]()
    wrong = []
    for seed in seeds(part):
        try:
            found[check(seed)] += 1
        except AssertionError as error:
            wrong.append(f"seed {seed}: {error}")
    assert not wrong, "\n".join(wrong)
    assert found["ran"] > found.total() / 2


@pytest.mark.campaign
def test_optimization_by_the_compiler_changes_no_bit(monkeypatch):
    """Ordinary tests compile without optimization."""
    found = {}
    for flags in ("-O0", "-O1", ""):
        monkeypatch.setenv("TRUSSFLOW_CFLAGS", flags)
        runs = [run(build(seed), seed, "compiled") for seed in seeds(0)]
        found[flags] = [
            (how, [v.tobytes() for v in all_of.values()]) for how, all_of in runs
        ]
    assert sum(how == "ran" for how, _ in found[""]) > DIAGRAM_COUNT / 2
    assert found["-O0"] == found["-O1"] == found[""]


def goes_on(seed, file):
    """Save the diagram of a seed on the way, and go on from the file; return how that went."""
    diagram, r = build(seed), random.Random(seed)
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            outputs = [
                port
                for block in flatten(diagram).blocks.values()
                for port in block.outputs()
            ]
            solver = r.choice(["rk4", "euler", "RK45"])
            one = Session(
                diagram,
                outputs=outputs,
                step=0.05,
                solver=solver,
                backend="interpreted",
            )
            other = one.twin()
            with one, other:
                one.advance(r.choice([0.0, 0.2, 0.2371]))
                other.advance(0.3)
                one.save(file)
                other.restore(file)
                for t in (one.time, 0.4, 0.6):
                    one.advance(t)
                    other.advance(t)
                    assert one.row().tobytes() == other.row().tobytes()
                    assert one.states().tobytes() == other.states().tobytes()
    except TrussflowError as error:
        return type(error).__name__
    return "went on"


@parts
def test_random_diagrams_go_on_from_files_bit_for_bit(part, tmp_path):
    found = Counter(goes_on(seed, tmp_path / "a.state") for seed in seeds(part))
    assert found["went on"] > found.total() / 2
    assert not found["SimulationError"]
