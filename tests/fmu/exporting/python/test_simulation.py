"""A pythonfmu FMU is valid, and runs as the diagram runs here."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from trussflow.blocks import (
    Block,
    Diagram,
    Event,
    Input,
    Output,
    PythonFunction,
    Session,
    Simulator,
    State,
    StateSpace,
    Step,
)
from trussflow.fmu.exporting.export import export as fmu_export

AGREEMENT = 1e-10  # of the requirement; the same code runs in both, so it is equal to the bit
POINT = 0.01
Export = Callable[..., Path]
Start = Callable[..., Any]


@pytest.fixture(scope="module")
def reference(make_loop):
    """Return what runs the loop in this process, the goal set at each point."""

    def rows(python, number):
        with Session(make_loop(python=python), step=1e-3) as session:
            session.start(parameters={"plant.stiffness": 7.0})
            found = []
            for k in range(number):
                session.set(goal=[np.sin(k), 0.5])
                session.advance((k + 1) * POINT)
                found.append(np.concatenate([v.ravel() for v in session.outputs.values()]))
        return np.array(found)

    return rows


def outputs_of(names):
    wanted = ("angle[", "load[", "torque[", "mean[")
    return [name for name in names if name.startswith(wanted)]


def test_validator_reports_nothing(loop_fmu):
    assert validate_fmu(str(loop_fmu)) == []


def test_stepped_fmu_equals_the_diagram_in_this_process(loop_fmu, slave, reference):
    one = slave(loop_fmu).start()
    python = "mean[1]" in one.references
    outputs, found = outputs_of(list(one.references)), []
    for k in range(60):
        one.set({"goal[1]": np.sin(k), "goal[2]": 0.5})
        one.fmu.doStep(k * POINT, POINT)
        found.append(one.get(*outputs))
    expected = reference(python, 60)
    assert np.ptp(expected, axis=0).min() > 1e-3
    np.testing.assert_allclose(found, expected, rtol=0, atol=AGREEMENT)
    assert one.errors == ""


def test_simulate_fmu_equals_a_whole_run(make_loop, export):
    """With the default experiment, to its end, recorded at every step."""
    fmu = export(make_loop(python=False), stop_time=0.5)
    result = fmpy.simulate_fmu(str(fmu), start_values={"plant.release[1]": 0.1})
    diagram = make_loop(python=False)
    diagram_in = Diagram("closed")
    diagram_in.add(loop=diagram)
    diagram_in.ground(diagram.goal)
    whole = Simulator(diagram_in, step=1e-3, log=["loop.angle", "loop.torque"]).run(
        0.5, parameters={"loop.plant.release": [0.1, -0.2]}
    )
    np.testing.assert_allclose(result["time"], whole.time, rtol=0, atol=1e-12)
    for name in ("angle", "torque"):
        for i in range(2):
            expected = whole[f"loop.{name}"].values[:, i]
            assert np.ptp(expected) > 0.1
            np.testing.assert_allclose(result[f"{name}[{i + 1}]"], expected, atol=AGREEMENT, rtol=0)


def test_points_off_the_grid(loop_fmu, slave):
    """The internal steps become shorter there; what is sampled keeps its instants."""
    ends = []
    for length in (0.02, 0.02 / 7):
        one = slave(loop_fmu).start({"goal[1]": 1.0})
        for k in range(round(0.2 / length)):
            one.fmu.doStep(k * length, length)
        ends.append(one.get("angle[1]", "angle[2]", "time"))
        assert one.errors == ""
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-9)


def test_both_kinds_of_fmu_give_the_same(make_loop, tmp_path, slave):
    """They have the same variables, and agree to round-off, off the grid as well."""
    diagram, ends = make_loop(python=False), []
    for kind in ("native", "python"):
        one = slave(fmu_export(diagram, tmp_path / f"{kind}.fmu", kind=kind, step=0.005))
        one.start({"goal[1]": 0.3, "plant.v[2]": 0.5}, time=0.2)
        rows = [one.get()]
        for k in range(12):
            one.set({"goal[2]": np.sin(k)})
            one.fmu.doStep(0.2 + 0.017 * k, 0.017)
            rows.append(one.get())
        ends.append((list(one.references), rows))
    assert ends[0][0] == ends[1][0]
    np.testing.assert_allclose(ends[1][1], ends[0][1], rtol=0, atol=AGREEMENT)


def test_states_derivatives_and_parameters_can_be_read(loop_fmu, slave):
    one = slave(loop_fmu).start({"plant.v[2]": 0.5, "goal[1]": 1.0})
    q, v = one.get("plant.q[1]", "plant.q[2]"), one.get("plant.v[1]", "plant.v[2]")
    rate = one.get("der(plant.q[1])", "der(plant.q[2])")
    np.testing.assert_array_equal(q, [0.3, -0.2])  # from the parameter `release`
    np.testing.assert_array_equal(v, [0.0, 0.5])  # set before the initialization
    np.testing.assert_array_equal(rate, v)
    assert one.get("plant.stiffness", "goal[1]", "time").tolist() == [7.0, 1.0, 0.0]
    one.step(0, 3, POINT)
    assert one.get("time") == 3 * POINT
    assert one.errors == ""
    one.fmu.terminate()
    assert one.get("time") == 3 * POINT


def test_outputs_follow_inputs_and_tuned_parameters_at_once(loop_fmu, slave):
    """Torque = gain (goal - angle) while the law's clock ticks; a tuned gain counts from now."""
    one = slave(loop_fmu).start()
    one.step(0, 2, POINT)
    angle, total = one.get("angle[1]"), one.get("torque[1]") + 2 * one.get("angle[1]")
    for gain, goal in ((2.0, 1.0), (3.0, 1.0), (3.0, -2.0)):
        one.set({"law.gain": gain, "goal[1]": goal})
        np.testing.assert_allclose(one.get("torque[1]"), gain * (goal - angle) + total, rtol=1e-12)
    assert one.errors == ""


@pytest.mark.parametrize("start", [0.0, 0.25])
def test_start_time_is_the_time_of_the_equations(export, slave, start):
    """A step at 0.3 s comes at 0.3 s, whenever the run began."""
    diagram = Diagram("late")
    step, lag = diagram.add(step=Step(0.3), lag=StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]]))
    step.y >> lag.u[0]
    diagram.expose(y=lag.y)
    one = slave(export(diagram, step=0.01)).start(time=start)
    for k in range(20):
        one.fmu.doStep(start + k * 0.05, 0.05)
    end = start + 1.0
    np.testing.assert_allclose(one.get("y[1]"), 1.0 - np.exp(-(end - 0.3)), rtol=1e-9)
    assert one.get("time") == pytest.approx(end, rel=1e-14)


def test_adaptive_solver_may_step_anywhere(export, slave):
    lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    one = slave(export(lag, solver="DOP853")).start({"u[1]": 1.0})
    time = 0.0
    for length in (0.1234567, np.pi / 7, 1 / 3):
        one.fmu.doStep(time, length)
        time += length
        np.testing.assert_allclose(one.get("y[1]"), 1.0 - np.exp(-time), rtol=1e-7)


class Ball(Block):
    """A Python block with continuous states and events: it bounces off the floor, losing nothing.

    The solver stops at each bounce, so that parabolas are followed to round-off.
    """

    traced = False
    height = Output(unit="m")
    h = State(initial=1.25)
    v = State()
    floor = Event("falling")

    def output(self, t, x, u, p):
        return {"height": x.h}

    def derivative(self, t, x, u, p):
        return {"h": x.v, "v": np.asarray(-10.0)}

    def indicators(self, t, x, u, p):
        return {"floor": x.h}

    def on_event(self, t, x, u, p, fired):
        return {"v": np.abs(x.v)}

    def feedthrough(self):
        return {"height": ()}


def test_python_block_with_events_is_an_fmu_too(export, slave):
    """h(t) = 1.25 - 5 t^2 until 0.5 s, where it starts again with 5 m/s: periods of 1 s."""
    one = slave(export(Ball(), step=0.04)).start()
    for k in range(22):
        one.fmu.doStep(k * 0.1, 0.1)
    assert one.errors == ""
    np.testing.assert_allclose(one.get("height", "v"), [1.25 - 5 * 0.2**2, -2.0], rtol=0, atol=1e-9)


def test_function_of_a_script_needs_nothing_of_it(export, slave):
    """Closures, globals, default values and lambdas go with the block."""
    offset = 0.25
    scale = np.array([1.0, 10.0])

    def helper(value):
        return value * scale

    def function(u, power=2):
        return helper(u**power) + offset

    block = PythonFunction(function, 0.01, inputs={"u": Input((2,))}, outputs={"y": Output((2,))})
    fmu = export(block)
    scale[:] = np.nan  # the FMU has its own copy
    one = slave(fmu).start({"u[1]": 3.0, "u[2]": 2.0})
    for k in range(3):  # at the start too, and at each instant from the inputs of that time
        one.set({"u[1]": 3.0 + k})
        np.testing.assert_array_equal(one.get("y[1]", "y[2]"), [(3.0 + k) ** 2 + 0.25, 40.25])
        one.fmu.doStep(k * 0.01, 0.01)
