"""FMUs in the master: rolled back, iterated, discarding, following their inputs or not."""

import contextlib
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from pythonfmu.builder import FmuBuilder

from trussflow.blocks import (
    AlgebraicLoopError,
    Constant,
    CoSimulator,
    Diagram,
    SimulationError,
    StateSpace,
    Step,
    Sum,
    cosimulate,
    simulate,
)
from trussflow.blocks.cosimulation.coupling import Coupled
from trussflow.blocks.cosimulation.step_control import StepControl
from trussflow.fmu import Fmu, export
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation

H = 0.125  # s
INNER = H / 64  # s; a step of Runge-Kutta that is exact to 1e-10

# x' = -2 x + u, y = x: an FMU by another generator, which says nothing of dependencies, does not
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
    script = folder / "refusing_lag.py"  # no other FMU of this process may have that module
    script.write_text(LAG)
    return Path(FmuBuilder.build_FMU(script, dest=folder, canGetAndSetFMUstate=True))


def line(gain, start):
    """Return x' = -x + u, y = x + gain u."""
    return StateSpace([[-1.0]], [[1.0]], [[1.0]], [[gain]], initial_value=[start])


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lines")

    def build(gain):
        files = folder / f"a{gain}.fmu", folder / f"b{gain}.fmu"
        for file, start in zip(files, (1.0, -0.3), strict=True):
            if not file.exists():
                export(line(gain, start), file, step=INNER)
        return files

    return build


def loop(a, b, y="y"):
    diagram = Diagram("loop")
    diagram.add(a=a, b=b)
    diagram.connect(a.port(y), b.port("u"))
    diagram.connect(b.port(y), a.port("u"))
    return diagram


def test_a_feedthrough_loop_of_two_fmus_is_solved_exactly(lines):
    """Loop gains of 0.25 and of 4; see the same test of units without FMUs for the closed form."""
    f = np.exp(-H)
    for gain in (0.5, -2.0):
        k = 1.0 - f + gain
        x = np.array([1.0, -0.3])
        expected = [np.linalg.solve([[1.0, -gain], [-gain, 1.0]], x)]
        for _ in range(8):
            y = np.linalg.solve([[1.0, -k], [-k, 1.0]], f * x)
            x = f * x + (1.0 - f) * y[::-1]
            expected.append(y)
        a, b = lines(gain)
        diagram = loop(Fmu(a), Fmu(b))
        result = cosimulate(diagram, 8 * H, step=H, coupling="iterate")
        found = np.column_stack([result["a.y"][:, 0], result["b.y"][:, 0]])
        np.testing.assert_allclose(found, expected, rtol=1e-8)
        assert result.attrs["iterations"] > 8


STATES = "canGetAndSetFMUstate", "canSerializeFMUstate"


def without(file, target, flags=STATES):
    """Copy an FMU that says it cannot do something, by default save its state."""
    with zipfile.ZipFile(file) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                for flag in flags:
                    true, false = (f'{flag}="{word}"'.encode() for word in ("true", "false"))
                    assert true in content
                    content = content.replace(true, false)
            new.writestr(name, content)
    return target


def test_a_loop_is_refused_with_its_path(lines, tmp_path):
    a, b = lines(0.5)
    with pytest.raises(AlgebraicLoopError) as caught:
        cosimulate(loop(Fmu(a), Fmu(b)), 1.0, step=H)
    assert "a.y --wire--> b.u ==feedthrough==> b.y   [" in str(caught.value)
    assert "b.y --wire--> a.u ==feedthrough==> a.y   [" in str(caught.value)
    stuck = without(b, tmp_path / "stuck.fmu")
    with pytest.raises(AlgebraicLoopError, match=r"cannot go back to an earlier state: 'b'") as no:
        cosimulate(loop(Fmu(a), Fmu(stuck)), 1.0, step=H, coupling="iterate")
    assert "a.y --wire--> b.u ==feedthrough==> b.y   [" in str(no.value)
    with pytest.raises(SimulationError, match=r"choose steps by a tolerance.*'b'"):
        cosimulate(loop(Fmu(a), Fmu(stuck, delayed=True)), 1.0, step=H, tolerance=1e-2)
    cosimulate(loop(Fmu(a), Fmu(stuck, delayed=True)), 1.0, step=H)
    fixed = without(b, tmp_path / "fixed.fmu", ("canHandleVariableCommunicationStepSize",))
    with pytest.raises(SimulationError, match=r"these members take steps of one length only: 'b'"):
        cosimulate(loop(Fmu(a), Fmu(fixed, delayed=True)), 1.0, step=H, tolerance=1e-2)


def test_runs_can_be_repeated(lines):
    a, b = lines(0.5)
    master = CoSimulator(loop(Fmu(a), Fmu(b)), step=H, coupling="iterate", extrapolation=1)
    first, second = master.run(1.0), master.run(1.0)
    np.testing.assert_array_equal(first["a.y"], second["a.y"])
    with pytest.raises(SimulationError, match="the duration"):
        master.run(1.03)


def test_an_fmu_is_tried_whether_it_follows_its_inputs(lines, lag, tmp_path):
    def follows(block):
        diagram = Diagram("one")
        diagram.add(block=block)
        diagram.ground(block.port("u"))
        master = CoSimulator(diagram, step=H)
        result = master.run(4 * H)
        ports = [result[name].values for name in result.data_vars]
        assert np.isfinite(ports).all()
        with contextlib.closing(master.network.members[0].open()) as running:
            running.start(0.0, np.zeros(1))
            return running.refreshes

    direct, _ = lines(0.5)
    plain, _ = lines(0.0)
    assert follows(Fmu(direct))
    assert not follows(Fmu(plain)), "nothing depends on the input at once"
    assert not follows(Fmu(direct, delayed=True)), "told not to"
    assert not follows(Fmu(without(direct, tmp_path / "direct.fmu"))), "cannot be tried"
    assert not follows(Fmu(lag, step=H)), "shows outputs after steps only"


def test_trying_leaves_no_trace(lines):
    """The run equals that of the same unit in this process, from the first step on."""
    direct, _ = lines(0.5)

    def diagram(block):
        found = Diagram("driven")
        found.add(block=block, push=StateSpace([[-0.5]], [[0.0]], [[1.0]], initial_value=[2.0]))
        found.ground(found.push.u)
        found.connect(found.push.y, block.port("u"))
        return found

    ours = cosimulate(diagram(line(0.5, 1.0)), 2.0, step=H, members=["block"], solver_step=INNER)
    theirs = cosimulate(diagram(Fmu(direct)), 2.0, step=H, solver_step=INNER)
    np.testing.assert_allclose(theirs["block.y"], ours["block.y"], rtol=1e-13)


def test_unknown_dependencies_are_a_loop_that_iteration_solves(lag):
    """The implicit solution: x_new = f x + (1 - f) / 2 x_new of the other; both start at one."""
    with pytest.raises(AlgebraicLoopError, match=r"a\.x --wire--> b\.u ==feedthrough==> b\.x"):
        cosimulate(loop(Fmu(lag, step=H), Fmu(lag, step=H), "x"), 1.0, step=H)
    result = cosimulate(loop(Fmu(lag, step=H), Fmu(lag, step=H), "x"), 1.0, step=H, coupling="iterate")
    f = np.exp(-2.0 * H)
    expected = (f / (1.0 - (1.0 - f) / 2.0)) ** np.arange(9)
    np.testing.assert_allclose(result["a.x"], expected, rtol=1e-9)
    np.testing.assert_allclose(result["b.x"], expected, rtol=1e-9)


def test_steps_that_an_fmu_discards_are_taken_shorter(lag):
    """Two lags that feed each other, x' = -2 x + x: exp(-t)."""

    def diagram(**settings):
        a, b = (Fmu(lag, step=H, delayed=True, parameters=settings) for _ in range(2))
        return loop(a, b, "x")

    # It halves a step up to ten times by itself; longer ones are left to the choice of steps.
    longest = 4e-5
    result = cosimulate(diagram(longest=longest), 1.0, step=2.0**-10, tolerance=1e-2, extrapolation=1)
    t = result["time"].values
    assert result.attrs["discarded_steps"] > 0
    assert np.diff(t).max() <= 2**10 * longest
    assert np.diff(t).max() > 0.01
    np.testing.assert_allclose(result["a.x"], np.exp(-t), rtol=0, atol=1e-2)
    free = cosimulate(diagram(), 1.0, step=2.0**-10, tolerance=1e-2, extrapolation=1)
    assert free.attrs["discarded_steps"] == 0
    assert free.attrs["communication_steps"] < result.attrs["communication_steps"]
    with pytest.raises(SimulationError, match=r"'RefusingLag' .*discarded its step of .*, and all parts"):
        cosimulate(diagram(longest=1e-6), 1.0, step=H)
    for run in (cosimulate, simulate):  # one rule wherever it runs
        found = run(diagram(longest=0.01), 1.0, step=H)
        np.testing.assert_allclose(found["a.x"][-1], run(diagram(), 1.0, step=H)["a.x"][-1], rtol=1e-12)


def test_discarded_steps_leave_no_trace_in_fmus(lines, monkeypatch):
    """A run with rejections, and the accepted steps alone, are equal to the last bit."""

    def master():
        """Return a run with a jump in its middle, which long steps run into."""
        diagram = Diagram("kicked")
        a, b, kick, total = diagram.add(
            a=Fmu(lines(0.0)[0]), b=Fmu(lines(0.0)[1]), kick=Step(1.0, final_value=5.0), total=Sum("++")
        )
        diagram.connect(a.y[0], total.u1)
        diagram.connect(kick.y, total.u2)
        diagram.connect(total.y, b.u[0])
        diagram.connect(b.y, a.u)
        return CoSimulator(diagram, step=2.0**-10, tolerance=1e-2, extrapolation=1, log=["a.y", "b.y"])

    controls: list[StepControl] = []
    run = StepControl.run

    def noted(self, last, reached):
        controls.append(self)
        run(self, last, reached)

    monkeypatch.setattr(StepControl, "run", noted)
    result = master().run(2.0)
    assert result.attrs["rejected_steps"] > 0
    again = master()
    coupled, places = Coupled(again.network, again._scheme, again._grid), again._logged
    coupled.start()
    rows = [coupled.signals[places]]
    for number in np.diff(np.round(result["time"].values * 2**11).astype(int)):
        if coupled.k in controls[0].forgotten:
            coupled.forget()
        coupled.step(int(number))
        rows.append(coupled.signals[places])
    coupled.close()
    found = np.array(rows)
    np.testing.assert_array_equal(found[:, 0], result["a.y"][:, 0])
    np.testing.assert_array_equal(found[:, 1], result["b.y"][:, 0])


def test_parameters_reach_the_fmu(lag):
    diagram = Diagram("one")
    diagram.add(lag=Fmu(lag, step=H))
    diagram.ground(diagram.lag.u)
    with pytest.raises(SimulationError, match="discarded its step"):
        cosimulate(diagram, 1.0, step=H, parameters={"lag.longest": 1e-6})
    result = cosimulate(diagram, 1.0, step=H)
    assert json.loads(result.attrs["parameters"])["lag.longest"] == [1e9]
    assert result.attrs["diagram_hash"] == diagram.lag.description.token
    np.testing.assert_allclose(result["lag.x"], np.exp(-2.0 * result["time"]), rtol=1e-12)


@pytest.mark.parametrize("coupling", ["jacobi", "iterate"])
@pytest.mark.parametrize("first", [True, False])
def test_no_fmu_begins_with_what_nobody_gave(first, coupling, make_fmu, monkeypatch):
    """It begins with its own start values, then with what is wired; zero may not be allowed."""
    seen: list[list[float]] = []
    setup = LoadedCoSimulation.setup

    def recorded(self, *arguments, inputs=None, **more):
        seen.append(inputs.tolist())
        setup(self, *arguments, inputs=inputs, **more)

    monkeypatch.setattr(LoadedCoSimulation, "setup", recorded)
    discrete = 'variability="discrete" ><Integer start="{}"/>'
    path = make_fmu("types", replace={discrete.format(0): discrete.format(7)})
    diagram = Diagram("start")
    fmu, number = Fmu(path, kind="cs", step=0.1, start={"u": 1.5, "flag": 1.0}), Constant(3.0)
    diagram.add(**({"fmu": fmu, "number": number} if first else {"number": number, "fmu": fmu}))
    number.y >> fmu.port("number")
    result = cosimulate(diagram, 0.2, step=0.1, coupling=coupling)
    assert result["fmu.next"].values.tolist() == [4, 4, 4]
    assert {tuple(inputs) for inputs in seen} <= {(1.5, 7, 1), (1.5, 3, 1)}
