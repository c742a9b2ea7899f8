"""FMUs in a co-simulation: rolled back, iterated, discarding, following their inputs or not."""

import contextlib
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pythonfmu.builder import FmuBuilder
from systems import assert_near, series

from trussflow.blocks import (
    Constant,
    CoSimulator,
    Diagram,
    StateSpace,
    cosimulate,
    simulate,
)
from trussflow.blocks.errors import AlgebraicLoopError, SimulationError
from trussflow.fmu import Fmu, export
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation

H = 0.125  # s
INNER_STEP = H / 64  # s; a step of Runge-Kutta that is exact to 1e-10

# x' = -2 x + u, y = x: an FMU by another generator, which does not declare dependencies, does not
# follow inputs between steps, and refuses long steps.
LAG = """
from math import exp
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class RefusingLag(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x, self.u, self.longest = 1.0, 0.0, 1e9
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        self.register_variable(
            Real("longest", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed)
        )

    def do_step(self, current_time, step_size):
        if step_size > self.longest:
            return False
        f = exp(-2.0 * step_size)
        self.x = f * self.x + (1.0 - f) / 2.0 * self.u
        return True
"""


@pytest.fixture(scope="module")
def lag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lag")
    # no other FMU of this process may have that module
    script = folder / "refusing_lag.py"
    script.write_text(LAG)
    return Path(FmuBuilder.build_FMU(script, dest=folder, canGetAndSetFMUstate=True))


def line(gain, start=1.0):
    """Return x' = -x + u, y = x + gain u."""
    return StateSpace([[-1.0]], [[1.0]], [[1.0]], [[gain]], initial_value=[start])


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    """Return two lines with feedthrough, and one without."""
    folder = tmp_path_factory.mktemp("lines")
    blocks = line(-2.0), line(-2.0, -0.3), line(0.0)
    return [
        export(block, folder / f"{i}.fmu", step=INNER_STEP)
        for i, block in enumerate(blocks)
    ]


def loop(a, b, y="y"):
    diagram = Diagram("loop")
    diagram.add(a=a, b=b)
    a.port(y) >> b.u
    b.port(y) >> a.u
    return diagram


def test_a_feedthrough_loop_of_two_fmus_is_solved_as_that_of_their_blocks(lines):
    """With a loop gain of 4, twice; the test of units without FMUs has the closed form."""
    a, b, _ = lines
    settings = {"step": H, "coupling": "iterate"}
    expected = cosimulate(
        loop(line(-2.0), line(-2.0, -0.3)),
        8 * H,
        members=["a", "b"],
        solver_step=INNER_STEP,
        **settings,
    )
    master = CoSimulator(loop(Fmu(a), Fmu(b)), **settings)
    first, second = master.run(8 * H), master.run(8 * H)
    for name in ("a.y", "b.y"):
        assert_allclose(first[name], expected[name], rtol=1e-8)
        assert_array_equal(second[name], first[name])


STATES = "canGetAndSetFMUstate", "canSerializeFMUstate"


def without(file, target, flags=STATES):
    """Copy an FMU whose description denies a capability, by default to save its state."""
    with zipfile.ZipFile(file) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                for flag in flags:
                    true, false = (
                        f'{flag}="{word}"'.encode() for word in ("true", "false")
                    )
                    assert true in content
                    content = content.replace(true, false)
            new.writestr(name, content)
    return target


def test_a_loop_is_refused_with_its_path(lines, tmp_path):
    a, b, _ = lines
    stuck = without(b, tmp_path / "stuck.fmu")
    fixed = without(
        b, tmp_path / "fixed.fmu", ["canHandleVariableCommunicationStepSize"]
    )
    for second, text, coupling in (
        (b, "==feedthrough==>", "jacobi"),
        (stuck, r"cannot return to an earlier state: 'b'", "iterate"),
    ):
        with pytest.raises(AlgebraicLoopError, match=text) as caught:
            cosimulate(loop(Fmu(a), Fmu(second)), 1.0, step=H, coupling=coupling)
        assert "a.y --wire--> b.u ==feedthrough==> b.y   [" in str(caught.value)
    assert "b.y --wire--> a.u ==feedthrough==> a.y   [" in str(caught.value)
    for second, text in (
        (stuck, r"control steps by a tolerance.*'b'"),
        (fixed, r"these members have a fixed step: 'b'"),
    ):
        diagram = loop(Fmu(a), Fmu(second, delayed=True))
        with pytest.raises(SimulationError, match=text):
            cosimulate(diagram, 1.0, step=H, tolerance=1e-2)
        cosimulate(diagram, 1.0, step=H)


def test_an_fmu_is_tried_whether_it_follows_its_inputs(lines, lag, tmp_path):
    def follows(block, start=0.0):
        diagram = series("one", block=block)
        diagram.ground(block.u)
        master = CoSimulator(diagram, step=H)
        result = master.run(4 * H)
        assert np.isfinite([result[name].values for name in result.data_vars]).all()
        with contextlib.closing(master.network.members[0].open()) as running:
            running.start(0.0, np.full(1, start))
            return running.refreshes

    direct, _, plain = lines
    for start in (0.0, -1.0, 1e3):
        assert follows(Fmu(direct), start)
    assert not follows(Fmu(plain))  # nothing depends on the input at once
    assert not follows(Fmu(direct, delayed=True))  # as the user states
    assert not follows(Fmu(without(direct, tmp_path / "direct.fmu")))  # cannot be tried
    assert not follows(Fmu(lag, step=H))  # shows outputs after steps only


def test_trying_leaves_no_trace(lines):
    """The run equals that of the same unit in this process, from the first step on."""

    def run(block, **members):
        diagram = Diagram("driven")
        push = StateSpace([[-0.5]], [[0.0]], [[1.0]], initial_value=[2.0])
        diagram.add(block=block, push=push)
        diagram.ground(push.u)
        push.y >> block.u
        return cosimulate(diagram, 2.0, step=H, solver_step=INNER_STEP, **members)[
            "block.y"
        ]

    ours = run(line(-2.0), members=["block"])
    assert_allclose(run(Fmu(lines[0])), ours, rtol=1e-13)


def test_unknown_dependencies_are_a_loop_that_iteration_solves(lag):
    """The implicit solution: x_new = f x + (1 - f) / 2 x_new of the other; both start at one."""
    diagram = loop(Fmu(lag, step=H), Fmu(lag, step=H), "x")
    with pytest.raises(
        AlgebraicLoopError, match=r"a\.x --wire--> b\.u ==feedthrough==> b\.x"
    ):
        cosimulate(diagram, 1.0, step=H)
    result = cosimulate(diagram, 1.0, step=H, coupling="iterate")
    f = np.exp(-2.0 * H)
    expected = (f / (1.0 - (1.0 - f) / 2.0)) ** np.arange(9)
    for name in ("a.x", "b.x"):
        assert_allclose(result[name], expected, rtol=1e-9)


def test_steps_that_an_fmu_discards_are_taken_shorter(lag):
    """Two lags that feed each other, x' = -2 x + x: exp(-t)."""

    def diagram(**settings):
        a, b = (Fmu(lag, step=H, delayed=True, parameters=settings) for _ in range(2))
        return loop(a, b, "x")

    # It halves a step up to ten times by itself; longer ones are left to the choice of steps.
    longest = 4e-5
    chosen = {"step": 2.0**-10, "tolerance": 1e-2}
    result = cosimulate(diagram(longest=longest), 1.0, **chosen)
    t = result["time"].values
    assert result.attrs["discarded_steps"] > 0
    assert 0.01 < np.diff(t).max() <= 2**10 * longest
    assert_near(result["a.x"], np.exp(-t), 1e-2)
    free = cosimulate(diagram(), 1.0, **chosen)
    assert free.attrs["discarded_steps"] == 0
    assert free.attrs["communication_steps"] < result.attrs["communication_steps"]
    with pytest.raises(
        SimulationError,
        match=r"'RefusingLag' .*discarded its step of .*, and all parts",
    ):
        cosimulate(diagram(longest=1e-6), 1.0, step=H)
    for run in (cosimulate, simulate):  # one rule wherever it runs
        found, expected = (
            run(diagram(**limit), 1.0, step=H) for limit in ({"longest": 0.01}, {})
        )
        assert_allclose(found["a.x"][-1], expected["a.x"][-1], rtol=1e-12)


def test_parameters_reach_the_fmu(lag):
    diagram = series("one", lag=Fmu(lag, step=H))
    diagram.ground(diagram.lag.u)
    with pytest.raises(SimulationError, match="discarded its step"):
        cosimulate(diagram, 1.0, step=H, parameters={"lag.longest": 1e-6})
    result = cosimulate(diagram, 1.0, step=H)
    assert json.loads(result.attrs["parameters"])["lag.longest"] == [1e9]
    assert result.attrs["diagram_hash"] == diagram.lag.description.token
    assert_allclose(result["lag.x"], np.exp(-2.0 * result["time"]), rtol=1e-12)


@pytest.mark.parametrize("coupling", ["jacobi", "iterate"])
@pytest.mark.parametrize("order", [["fmu", "number"], ["number", "fmu"]])
def test_no_fmu_begins_with_inputs_that_nobody_gave(
    order, coupling, make_fmu, monkeypatch
):
    """It begins with its own start values, then with the wired signals; zero may not be allowed."""
    inputs_at_start = set()
    setup = LoadedCoSimulation.setup

    def recorded(self, *arguments, inputs=None, **more):
        inputs_at_start.add(tuple(inputs))
        setup(self, *arguments, inputs=inputs, **more)

    monkeypatch.setattr(LoadedCoSimulation, "setup", recorded)
    discrete = 'variability="discrete" ><Integer start="{}"/>'
    path = make_fmu("types", replace={discrete.format(0): discrete.format(7)})
    diagram = Diagram("start")
    fmu = Fmu(path, kind="cs", step=0.1, start={"u": 1.5, "flag": 1.0})
    blocks = {"fmu": fmu, "number": Constant(3.0)}
    diagram.add(**{name: blocks[name] for name in order})
    diagram.number >> fmu.port("number")
    result = cosimulate(diagram, 0.2, step=0.1, coupling=coupling)
    assert result["fmu.next"].values.tolist() == [4, 4, 4]
    assert inputs_at_start <= {(1.5, 7, 1), (1.5, 3, 1)}
