"""Runs side by side, one in each lane of vectors: to the bit what each is alone, whatever the others do."""

import os
from itertools import product

import campaign
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from systems import cubic, ports, ring

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Event,
    Function,
    Gain,
    Input,
    Integrator,
    MatrixGain,
    Mode,
    Noise,
    Output,
    Parameter,
    PythonFunction,
    RateBoundedAllocation,
    Relay,
    Simulator,
    Sine,
    State,
    Sum,
    Table,
    UnitDelay,
    ZeroOrderHold,
    simulate,
    sweep,
)
from trussflow.blocks.errors import DivergenceError, ParameterError
from trussflow.blocks.simulation.lanes import Lanes, Points, most_lanes
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.blocks.sweeps import samples
from trussflow.blocks.sweeps.reductions import REDUCTIONS
from trussflow.blocks.tracing import compiler
from trussflow.blocks.tracing.kernels import repeated

STEP = 0.01
ALWAYS = "trussflow.blocks.sweeps.sweep.MIN_BATCHED_STEPS", 0.0
"""Setting with which any sweep goes in lanes."""

ALONE = {"time_limit": 600.0, "executor": "serial"}
"""Settings with which each run of a sweep goes alone."""


def wave(a, b):
    """Return what series compute in all lanes at once, and C's functions in the lanes that are outside."""
    powers = np.exp(a) + np.log(1.0 + b**2) + (1.0 + a**2) ** b
    return np.sin(1e5 * a) + np.cos(b), powers + np.log(np.maximum(a, 0.0) + 1e-305)


class Functions(Block):
    """Functions of all kinds of a state, of time and of parameters, in kernels and outside."""

    u = Input()
    x = State(3, initial=[0.3, -0.2, 0.9])
    rate, offset = Parameter([1.0, 2.0, 0.5], shape=3), Parameter(0.1)
    y, powers = Output(3), Output(3)

    def output(self, t, x, u, p):
        instances = [(x.x[i], p.rate[i] * x.x[i - 1]) for i in range(3)]
        waves, powers = zip(*repeated(wave, instances), strict=True)
        bent = np.arctan2(x.x, 1.0 + t) + np.sqrt(np.abs(x.x)) + np.tanh(p.rate * x.x)
        bent = (
            bent
            + np.where(x.x > p.offset, np.minimum(x.x, t), np.mod(x.x, 0.3))
            + np.floor(3.0 * x.x)
        )
        return {
            "y": np.stack(waves) + bent,
            "powers": np.stack(powers) - x.x**2 * p.offset,
        }

    def derivative(self, t, x, u, p):
        y = self.output(t, x, u, p)["y"]
        return {
            "x": np.sin(p.rate * t + x.x) - p.offset * x.x + 0.1 * u.u / (1.0 + y**2)
        }


def functions():
    diagram = Diagram("functions")
    block, sine, noise = diagram.add(
        f=Functions(), sine=Sine(2.0), noise=Noise(0.3, 0.02, seed=5)
    )
    sine + noise >> block.u
    table = diagram.add(table=Table([-1.0, 0.0, 2.0], [1.0, -1.0, 3.0]))
    block.y[0] >> table
    return diagram


def rates(count):
    """Return sampled blocks behind one another, of so many sample times; more than five share one program."""
    diagram = Diagram("rates")
    x = diagram.add(x=Integrator(0.5))
    last = x
    for k in range(count):
        kind = [ZeroOrderHold, UnitDelay][k % 2]
        last = last >> diagram.add(f"b{k}", kind(STEP * (2 + k)))
    total, back = diagram.add(total=Sum("+-"), back=Gain(0.7))
    x >> back >> total.u2
    last >> total.u1
    total >> x
    return diagram


def allocated():
    """Return a controller whose actuators have limits: iterations in C, of one run after the other."""
    diagram = Diagram("allocated")
    x, wanted = diagram.add(
        x=Integrator([0.5, -0.4]), wanted=MatrixGain([[-3.0, 1.0], [0.5, -4.0]])
    )
    share = diagram.add(
        share=RateBoundedAllocation(2, np.full(3, 0.1), np.full(3, 5.0), 0.02)
    )
    matrix = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]])
    for name, value in (
        ("effectiveness", matrix),
        ("spread", np.eye(2)),
        ("lower", np.full(3, -0.6)),
        ("upper", np.full(3, 0.6)),
    ):
        diagram.add(name, Constant(value)) >> share.port(name)
    apply = diagram.add(apply=MatrixGain(matrix))
    x >> wanted >> share.demand
    share.command >> apply >> x
    return diagram


def several(simulator, count):
    """Return parameters and initial states of so many runs, all of them others."""
    plan, random = simulator.prepared.plan, np.random.default_rng(7)
    p = plan.parameters(None)
    x, _ = plan.initial(p, None)
    of_p = {
        n: v
        for n, v in plan.p.named(p).items()
        if n.startswith(("f.", "back.", "wanted.", "sine."))
    }
    return [
        tuple(
            {
                name: value + 0.3 * random.standard_normal(np.shape(value))
                for name, value in own.items()
            }
            for own in (of_p, plan.x.named(x))
        )
        for _ in range(count)
    ]


def in_lanes(simulator, duration, each, count):
    """Return the results of runs with these parameters and initial states, each of them in a lane."""
    plan, points = simulator.prepared.plan, []
    for parameters, initial in each:
        p = plan.parameters(parameters)
        points.append((*plan.initial(p, initial), p))
    lanes, found = Lanes(simulator, count), {}
    arrays = Points(*map(np.stack, zip(*points, strict=True)))
    for runs in lanes.run(duration, arrays, "stop"):
        found |= {i: runs.dataset(k) for k, i in enumerate(runs.runs)}
    return [found[i] for i in range(len(each))]


def assert_same(found, alone):
    assert found.equals(alone)
    for name in ("run_hash", "status", "parameters", "initial_states"):
        assert found.attrs[name] == alone.attrs[name]


@pytest.mark.parametrize("solver", FIXED_STEP)
@pytest.mark.parametrize(
    "diagram, count",
    [
        *product([functions()], [1, 4, 8]),
        *product([rates(3), rates(8), allocated()], [compiler.lanes()]),
        (cubic(), 1),
    ],
)
def test_each_lane_is_the_run_alone_to_the_bit(diagram, count, solver):
    simulator = Simulator(diagram, step=STEP, log_step=3 * STEP, solver=solver)
    each = several(simulator, 7)
    found = in_lanes(simulator, 0.9, each, count)
    for result, (parameters, initial) in zip(found, each, strict=True):
        assert_same(result, simulator.run(0.9, parameters=parameters, initial=initial))
    ends = {result.to_array().values[:, -1].tobytes() for result in found}
    assert len(ends) == len(each)


def test_zeros_have_the_same_sign():
    """A matrix product of zeros, whose sign an angle shows."""
    diagram = ring(x=Integrator(np.zeros(12)), back=Gain(-1.0))
    matrix = np.random.default_rng(0).standard_normal((12, 12))
    y = diagram.x >> diagram.add(y=MatrixGain(matrix))
    np.arctan2(-y.y, -1.0 * diagram.add(one=Constant(np.ones(12))).y)
    simulator = Simulator(diagram, step=STEP)
    (found,) = in_lanes(simulator, 0.1, [({}, {})], compiler.lanes())
    assert_same(found, simulator.run(0.1))


def exploding():
    """Return x' = x^2, which has no end at t = 1/x(0), with the sum of all its samples."""
    diagram = ring("exploding", x=Integrator(0.1), square=Function(np.square))
    hold, total, last = diagram.add(
        hold=UnitDelay(STEP), total=Sum("++"), last=ZeroOrderHold(STEP)
    )
    diagram.x >> last >> total.u1
    hold >> total.u2
    total >> hold
    return diagram


def test_a_run_that_diverges_disturbs_no_other(monkeypatch):
    starts = [0.1, 3.0, -1.0, 0.9, 0.2, 1.5, -2.0, 0.05, 40.0, 0.3, 0.1]
    settings = {
        "vary": {"x.integral": starts},
        "keep": "all",
        "executor": "serial",
        "step": STEP,
    }
    alone = sweep(exploding(), 2.0, **settings | ALONE)
    assert alone["status"].values.tolist().count("diverged") == 4
    assert sweep(exploding(), 2.0, **settings).equals(alone)
    monkeypatch.setattr(*ALWAYS)
    runs, run = [], samples.Runs.run
    monkeypatch.setattr(samples.Runs, "run", lambda *own: runs.append(own) or run(*own))
    together = sweep(exploding(), 2.0, **settings)
    assert together.equals(alone)
    assert len(runs) == 4  # those that diverged, for their messages
    everyone = sweep(
        exploding(), 2.0, **(settings | {"vary": {"x.integral": [3.0, 4.0, 5.0, 6.0]}})
    )
    assert set(everyone["status"].values) == {"diverged"}


def test_a_step_after_the_end_is_of_no_account(monkeypatch):
    # without a solution beyond t = exp(-x(0))
    diagram = ring("steep", x=Integrator(0.0), steep=Function(np.exp))
    settings = {"vary": {"x.integral": [0.0, -2.0, -1.0]}, "step": STEP}
    settings |= {"keep": {"x.y": "max"}, "executor": "serial"}
    after = sweep(diagram, 1.0 + STEP, **settings)
    assert after["status"].values.tolist() == ["diverged", "complete", "complete"]
    alone = sweep(diagram, 1.0, **settings | ALONE)
    monkeypatch.setattr(samples.Runs, "run", None)
    assert sweep(diagram, 1.0, **settings).equals(alone)


@pytest.fixture
def used(monkeypatch):
    """Return the numbers of lanes that code was compiled for, and the numbers of runs that went in them."""
    counts, runs = [], []

    class Counted(Lanes):
        def __init__(self, simulator, count):
            counts.append(count)
            super().__init__(simulator, count)

        def run(self, duration, points, not_finite):
            runs.append(len(points.x))
            return super().run(duration, points, not_finite)

    monkeypatch.setattr(samples, "Lanes", Counted)
    return counts, runs


@pytest.mark.parametrize("executor", ["serial", "threads", campaign.only("processes")])
def test_a_sweep_is_the_same_in_lanes(monkeypatch, used, executor):
    counts, runs = used
    settings = {
        "vary": {"f.x[0]": stats.norm(0.3, 0.2), "f.offset": stats.uniform(0.0, 0.3)},
        "samples": 24,  # full groups, of whatever lanes there are
        "seed": 4,
        "keep": {"f.y": "final", "f.powers": "peak"},
        "step": STEP,
    }
    alone = sweep(functions(), 1.0, **settings, **ALONE)
    assert not counts
    monkeypatch.setattr(*ALWAYS)
    together = sweep(functions(), 1.0, **settings, executor=executor, workers=2)
    assert together.equals(alone)
    assert len(counts) == 1
    if executor != "processes":
        assert sum(runs) == 24


@pytest.mark.parametrize(
    "keep, instruction_seconds, begins_here",
    [
        ({"f.y": "final"}, 1e-9, True),
        ({"f.y": "final"}, 1.0, False),  # a batch may take longer than workers to start
        ({"pid": lambda _: os.getpid()}, 1e-9, False),
    ],
    ids=["short", "long", "function"],
)
def test_only_short_batches_without_functions_run_in_this_process(
    monkeypatch, used, keep, instruction_seconds, begins_here
):
    monkeypatch.setattr(*ALWAYS)
    monkeypatch.setattr(
        "trussflow.blocks.sweeps.sweep.INSTRUCTION_SECONDS", instruction_seconds
    )
    settings = {"vary": {"f.offset": np.linspace(0.1, 0.2, 24)}, "step": STEP}
    found = sweep(functions(), 1.0, **settings, keep=keep, workers=1)
    assert set(found["status"].values) == {"complete"}
    assert bool(used[1]) is begins_here
    if "pid" in keep:
        assert os.getpid() not in found["pid"].values


def switched(block):
    return ring(x=Integrator(1.0), own=block)


@pytest.mark.parametrize(
    "diagram, settings, count",
    [
        (functions(), {"step": STEP}, compiler.lanes()),
        (functions(), {"solver": "RK45"}, 0),
        (cubic(), {"step": STEP}, 1),
        (functions(), {"step": STEP, "backend": "interpreted"}, 0),
        (switched(Relay(0.5, -0.5)), {"step": STEP}, 1),
        (
            switched(PythonFunction(lambda u: -u, STEP, **ports(u=(), y=()))),
            {"step": STEP},
            0,
        ),
    ],
)
def test_what_differs_from_run_to_run_goes_alone(diagram, settings, count):
    assert most_lanes(Simulator(diagram, **settings).prepared) == count


def test_short_or_small_sweeps_limits_and_functions_that_build_compile_nothing(
    monkeypatch, used
):
    counts, _ = used
    monkeypatch.setattr("trussflow.blocks.sweeps.sweep.lanes", lambda: 4)
    settings = {"vary": {"f.offset": [0.1, 0.2, 0.3]}, "keep": "all", "step": STEP}
    sweep(functions(), 1.0, **settings, executor="serial")
    monkeypatch.setattr(*ALWAYS)
    # each core has another one to run
    sweep(functions(), 1.0, **settings, executor="threads", workers=2)
    assert counts == [1, 1]
    sweep(functions(), 1.0, **settings, executor="serial", time_limit=60.0)
    sweep(rates, 1.0, vary={"count": [1, 2]}, keep="all", executor="serial", step=STEP)
    assert counts == [1, 1]
    sweep(functions(), 1.0, **settings, executor="serial")
    assert counts == [1, 1, 4]


class Tank(Block):
    """Two levels that start at a parameter, with outputs of several shapes."""

    level = State(2, initial="start")
    start = Parameter([1.0, 2.0], shape=2, minimum=-1.0)
    leak = Parameter(0.5, above=0.0, below=3.0)
    y, matrix, single, scalar = Output(2), Output((2, 2)), Output(1), Output()

    def output(self, t, x, u, p):
        a, b = x.level
        rows = [np.stack([a, b]), np.stack([a * b, np.sin(t)])]
        return {
            "y": x.level,
            "matrix": np.stack(rows),
            "single": np.stack([a + b]),
            "scalar": np.sqrt(a - 0.45),  # no number for some levels
        }

    def derivative(self, t, x, u, p):
        return {"level": -p.leak * x.level * np.exp(np.sin(9.0 * t))}


class Outlet(Tank):
    """Levels with an outlet that opens once, and an end of the run if the first level is high."""

    outlet = Mode()
    low, high = Event("falling"), Event("terminal")

    def derivative(self, t, x, u, p):
        return {"level": -p.leak * x.level * (1.0 + x.outlet)}

    def indicators(self, t, x, u, p):
        return {"low": x.level[0] - 0.4, "high": t * x.level[0] - 1.6}

    def on_event(self, t, x, u, p, happened):
        return {"outlet": np.where(happened.low, 1.0, x.outlet)}


class Doubled(Tank):
    """Levels that start at twice the parameter, by code."""

    def initial(self, name, p):
        return 2.0 * p.start


class Ordered(Tank):
    """Levels whose start must increase."""

    def check_parameters(self, p):
        if p.start[1] < p.start[0]:
            raise ParameterError("the levels must increase")


GRID = {"tank.start[1]": [1.0, 0.2, 3.0], "tank.leak": [0.5, 3.5, 1.0]}
"""Values of single elements, some of which are not allowed."""


@pytest.mark.parametrize("kind", [Tank, Outlet, Doubled, Ordered])
@pytest.mark.parametrize(
    "vary",
    [
        GRID,
        {"tank.start": [[1.0, 2.0], [0.0, 3.0]], "tank.start[0]": [1, 5]},
        {"tank.level": [[1.0, 2.0], [0.3, np.nan]], "tank.leak": [0.1, 0.2]},
        {"tank.level[0]": [0.1, 0.5, 9.0], "tank.start": [[2.0, 3.0], [3.0, 2.0]]},
    ],
    ids=["elements", "whole and element", "states", "states after parameters"],
)
def test_values_written_as_arrays_are_those_of_single_runs(monkeypatch, kind, vary):
    diagram = Diagram("drained")
    diagram.add(tank=kind())
    names = [name for name in REDUCTIONS if name != "all"]
    ports = "y", "matrix", "single", "scalar"
    keep = {f"{p} {n}": (f"tank.{p}", n) for p in ports for n in names}
    settings = {"vary": vary, "keep": keep, "step": STEP, "log_step": 3 * STEP}
    alone = sweep(diagram, 1.0, **settings, **ALONE)
    assert "complete" in alone["status"].values
    for _ in "one lane", "all lanes":
        together = sweep(diagram, 1.0, **settings, executor="serial")
        assert together.equals(alone)
        monkeypatch.setattr(*ALWAYS)


def test_defaults_that_cannot_run_do_not_matter():
    diagram = Diagram("singular", loops="solve")
    one, total, back, x = diagram.add(
        one=Constant(1.0), total=Sum("+-"), back=Gain(-1.0), x=Integrator()
    )
    one >> total.u1
    total >> back >> total.u2
    total >> x
    with pytest.raises(DivergenceError):
        simulate(diagram, 1.0, step=STEP)
    settings = {"vary": {"back.gain": [0.5, -1.0, 1.0]}, "step": STEP}
    settings |= {"keep": {"x.y": "final"}, "executor": "serial"}
    found = sweep(diagram, 1.0, **settings)
    assert found["status"].values.tolist() == ["complete", "diverged", "complete"]
    assert_allclose(found["x.y"][::2], [1.0 / 1.5, 1.0 / 2.0], rtol=1e-12)
    assert found.equals(sweep(diagram, 1.0, **settings | ALONE))


def test_as_many_lanes_as_the_processor_has(monkeypatch):
    for flags, count in (
        ("flags : fpu avx2 avx512f avx512dq", 8),
        ("flags : fpu avx2", 4),
        ("", 4),
    ):
        monkeypatch.setattr(compiler, "_processor", lambda flags=flags: flags)
        assert compiler.lanes() == count
