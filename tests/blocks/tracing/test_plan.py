"""Values of a plan: parameters and initial states, from declarations, inputs and overrides."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import Level, series

from trussflow.blocks import Constant
from trussflow.blocks.errors import NameLookupError, ParameterError, SimulationError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Output
from trussflow.blocks.simulation import executor as executor_module
from trussflow.blocks.simulation.simulator import Simulator, simulate
from trussflow.blocks.tracing import compiler
from trussflow.blocks.tracing.plan import Plan


class Decay(Block):
    y = Output(2)
    x = State(2, initial="start")
    rate = Parameter(1.0)
    start = Parameter((1.0, 2.0), 2)
    output = Level.output

    def derivative(self, t, x, u, p):
        return {"x": -p.rate * x.x}


class Lag(Level):
    """A filter that starts at its input."""

    def derivative(self, t, x, u, p):
        return {"x": u.u - x.x}

    def initial_state(self, u, p):
        return {"x": u.u}


def test_tunable_parameters_never_recompile(backend, monkeypatch):
    calls = []
    compile_library = compiler.compile_library

    def counted(content, files, functions):
        calls.append(content)
        return compile_library(content, files, functions)

    monkeypatch.setattr(executor_module, "compile_library", counted)
    diagram = series(decay=Decay())
    simulator = Simulator(diagram, step=0.01, backend=backend)
    for rate in (1.0, 0.5, 3.0):
        for start in ((1.0, 2.0), (5.0, -5.0)):
            overrides = {"decay.rate": rate, "decay.start": start}
            result = simulator.run(1.0, parameters=overrides)
            exact = np.exp(-rate * result.time.values)[:, np.newaxis] * start
            assert_allclose(result["decay.y"], exact, rtol=1e-7)  # RK4: (3 h)^5 / 120 h
    assert len(calls) == (backend == "compiled")
    assert_array_equal(diagram.decay.rate, 1.0)


def test_code_is_shared_by_what_differs_in_parameters_only(monkeypatch):
    """The content that names code in the cache is equal where the source is, and only there."""
    sources = []
    compile_library = compiler.compile_library

    def noted(content, files, functions):
        sources.append((content, "".join(files())))
        return compile_library(content, files, functions)

    monkeypatch.setattr(executor_module, "compile_library", noted)

    def build(*blocks, **settings):
        diagram = Diagram("d")
        for i, block in enumerate(blocks):
            diagram.add(f"block{i}", block)
        Simulator(diagram, backend="compiled", **({"step": 0.1} | settings))

    build(Decay())
    build(Decay(rate=2.0, start=(3.0, 4.0)))
    build(Decay(), step=0.2)
    assert len(set(sources)) == 1, "parameters and steps"
    build(Decay(), log=[])
    build(Constant(3.0))
    build(Constant(3.0), Constant(3.0))
    build(Constant(3.0).sampled(0.1), Constant(3.0))
    build(Constant(3.0), Constant(3.0).sampled(0.1))
    build(Constant(3.0).sampled(0.1), Constant(3.0).sampled(0.2))
    contents, texts = zip(*sources, strict=True)
    assert len(set(contents)) == len(set(texts)) == len(set(sources)) == 7


def test_overrides_win_and_are_seen_by_those_who_start_at_their_input():
    diagram = series(level=Constant(3.0), first=Lag(), second=Lag(), third=Lag())
    plan = Plan(diagram)
    p = plan.parameters({"level.value": 7.0})
    x, _ = plan.initial(p, {"second.x": 4.0})
    assert_array_equal(x, [7.0, 4.0, 4.0])


@pytest.mark.parametrize(
    "returned, cause, message",
    [
        (
            {"v": 1.0},
            NameLookupError,
            r"initial_state\(\) of block 'lag' returned 'v'; .*: x",
        ),
        (
            [1.0],
            NameLookupError,
            r"initial_state\(\) of block 'lag' returned \[1\.0\]; .*: x",
        ),
        (
            {"x": np.ones(2)},
            ParameterError,
            r"'lag\.x' has shape \(2,\); it must have shape \(\)",
        ),
        ({"x": np.nan}, ParameterError, r"'lag\.x' is not finite"),
        (
            None,
            SimulationError,
            r"initial_state\(\) of block 'lag' .* raised ZeroDivisionError",
        ),
    ],
)
def test_initial_states_from_inputs_are_checked(returned, cause, message):
    class Wrong(Lag):
        def initial_state(self, u, p):
            if returned is None:
                raise ZeroDivisionError
            return returned

    diagram = series(lag=Wrong())
    diagram.ground(diagram.lag.u)
    with pytest.raises(cause, match=message):
        simulate(diagram, 1.0, step=0.1, backend="numpy")


def test_error_in_plain_numpy_names_block_and_time():
    class Late(Lag):
        def derivative(self, t, x, u, p):
            if isinstance(t, np.ndarray) and t > 1.0:
                # not in the random check before the run
                raise RuntimeError("too late")
            return {"x": u.u}

    diagram = series(late=Late())
    diagram.ground(diagram.late.u)
    with pytest.raises(
        SimulationError,
        match=r"derivative\(\) of block 'late' \(Late\) raised Run.* at t = 1.05",
    ):
        simulate(diagram, 2.0, step=0.1, backend="numpy")
