"""Native FMUs give the trajectories of the block itself, whatever runs them."""

import re
from ctypes import POINTER, c_double
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from scipy.integrate import solve_ivp

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Integrator,
    Output,
    Simulator,
    Step,
    ZeroOrderHold,
    simulate,
)
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.models import SpaceTruss

ROUND_OFF = 1e-10
"""Sums in another order, over hundreds of steps."""


def in_process(block, force, duration, step):
    """Run a block with its inputs held constant, by RK4; log its outputs."""
    diagram = Diagram("alone")
    port = block.only_input()
    held = diagram.add(block=block, force=Constant(force))[1]
    held >> port
    return simulate(diagram, duration, step=step, backend="interpreted", progress=False)


def plant_force():
    """Return forces and torques that move every coordinate; rounding errors reach 6e-12 then.

    Ten times as much makes joints spin so fast that they grow to 1.1e-10 in speeds.
    """
    return np.random.default_rng(5).uniform(-0.1, 0.1, 52)


def test_plant_co_simulation_equals_in_process_rk4(plant_fmu, tmp_path, fmi):
    force = plant_force()
    expected = in_process(SpaceTruss.consistent(), force, 0.2, 1e-3)
    interface = variables(plant_fmu)
    with fmi.opened(plant_fmu, "cs", tmp_path) as fmu:
        fmi.started(fmu, {interface["actuation"]: force})
        for k in range(20):
            fmu.doStep(0.01 * k, 0.01)
        for port in SpaceTruss.consistent().outputs():
            name, found = port.name, fmi.read(fmu, interface[port.name], port.size)
            last = np.ravel(expected[f"block.{name}"][-1].values)
            scale = max(1.0, np.abs(last).max())
            np.testing.assert_allclose(found, last, rtol=0, atol=ROUND_OFF * scale, err_msg=name)


def variables(path):
    """Return the first value reference of each variable, from the model description."""
    found: dict[str, int] = {}
    for v in read_model_description(str(path)).modelVariables:
        found.setdefault(re.sub(r"\[.*\]", "", v.name), v.valueReference)
    return found


def test_plant_by_model_exchange_and_cvode(plant_fmu):
    """The start is bent: without actuation the truss rings and the robots swing."""
    start = np.zeros(40)
    start[34:] = 0.1
    start[6:34] = 0.1
    plant = SpaceTruss.consistent()
    expected = solved(plant, {"initial_coordinates": start}, 0.2, 1e-11)
    scalar = plant_fmu.name.endswith("2.0.fmu")
    values: dict[str, Any] = {f"initial_coordinates[{i + 1}]": v for i, v in enumerate(start)}
    result = simulate_fmu(
        str(plant_fmu),
        fmi_type="ModelExchange",
        stop_time=0.2,
        output_interval=0.01,
        relative_tolerance=1e-10,
        start_values=values if scalar else {"initial_coordinates": start},
        output=[f"coordinates[{i + 1}]" for i in range(40)] if scalar else ["coordinates"],
    )
    last = result[-1].tolist()
    found = np.ravel(last[1:] if scalar else last[1])
    np.testing.assert_allclose(found, expected[:40], rtol=0, atol=1e-7)


def solved(block, parameters, duration, rtol):
    """Return x at the end, by SciPy and the equations in the interpreter, inputs at zero."""
    interface = ExportInterface.of(block, parameters=parameters)
    x, d = interface.x, interface.d
    rates = interface.programs["derivative"].function
    solution = solve_ivp(
        lambda t, x: np.asarray(rates(t, x, d, interface.p)).ravel(),
        (0, duration),
        x,
        method="DOP853",
        rtol=rtol,
        atol=1e-13,
    )
    return solution.y[:, -1]


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_model_exchange_integrated_by_scipy(version, exported, tmp_path, fmi, systems):
    block = systems.Oscillator(3)
    path = exported(block, version, "three")
    expected = solved(systems.Oscillator(3), {"initial_position": [0.5, -1.0, 2.0]}, 5.0, 1e-12)
    start = variables(path)["initial_position"]
    with fmi.opened(path, "me", tmp_path) as fmu:
        fmi.started(fmu, {start: [0.5, -1.0, 2.0]})
        update(fmu)
        fmu.enterContinuousTimeMode()

        def rates(t, x):
            fmu.setTime(t)
            set_states(fmu, x)
            return get(fmu, "Derivatives", 6)

        x = get(fmu, "ContinuousStates", 6)
        found = solve_ivp(rates, (0, 5.0), x, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


def update(fmu):
    """Let an instance in event mode update its discrete states."""
    return fmu.newDiscreteStates() if hasattr(fmu, "setReal") else fmu.updateDiscreteStates()


def set_states(fmu, x):
    buffer = np.ascontiguousarray(x)
    pointer = buffer.ctypes.data_as(POINTER(c_double))
    fmu.setContinuousStates(pointer, x.size)


def get(fmu, what, n):
    buffer = (c_double * n)()
    name = (
        "ContinuousStateDerivatives"
        if what == "Derivatives" and hasattr(fmu, "getContinuousStateDerivatives")
        else what
    )
    getattr(fmu, f"get{name}")(buffer, n)
    return list(buffer)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("step", [1e-3, 4e-3, 0.1])
def test_communication_steps_do_not_matter(step, version, exported, tmp_path, fmi, systems):
    path = exported(systems.Oscillator(2), version, "two")
    expected = in_process(systems.Oscillator(2), np.array([0.3, 0.0]), 1.0, 1e-3)
    refs = variables(path)
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu, {refs["force"]: [0.3, 0.0]})
        for k in range(round(1.0 / step)):
            fmu.doStep(k * step, step)
        found = fmi.read(fmu, refs["position"], 2)
    np.testing.assert_allclose(found, expected["block.position"][-1], rtol=0, atol=1e-13)


def test_steps_off_the_grid_keep_the_order_of_the_method(exported, tmp_path, fmi, systems):
    path = exported(systems.Oscillator(2), "2.0", "coarse", step=0.05)
    refs = variables(path)
    exact = solved(systems.Oscillator(2), {}, 1.0, 1e-12)[:2]
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu)
        times = [0.0, 0.013, 0.07, 0.5, 0.5001, 0.93, 1.0]
        for begin, end in pairwise(times):
            fmu.doStep(begin, end - begin)
        found = fmi.read(fmu, refs["position"], 2)
    np.testing.assert_allclose(found, exact, rtol=0, atol=2e-6)


def test_inputs_held_between_communication_points(exported, tmp_path, fmi, systems):
    """The same as a diagram in which a sampled hold stands before the input."""
    path = exported(systems.Oscillator(1), "2.0", "one")
    diagram = Diagram("held")
    block, hold, wave = diagram.add(block=systems.Oscillator(1), hold=ZeroOrderHold(0.01), wave=Wave())
    wave >> hold >> block.force
    expected = simulate(diagram, 1.0, step=1e-3, progress=False)
    refs = variables(path)
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu)
        for k in range(100):
            fmi.write(fmu, refs["force"], [np.sin(9 * 0.01 * k)])
            fmu.doStep(0.01 * k, 0.01)
        found = fmi.read(fmu, refs["position"], 1)
    np.testing.assert_allclose(found, expected["block.position"][-1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_sampled_blocks_tick_inside_co_simulation(version, exported, tmp_path, fmi, systems):
    path = exported(systems.hybrid(), version)
    times, expected = hybrid_in_process(systems, 1.0)
    refs = variables(path)
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu, {refs["target"]: [0.7]})
        for k, t in enumerate(times[:-1]):
            for name, values in expected.items():
                found = fmi.read(fmu, refs[name], 1)
                np.testing.assert_allclose(found, values[k], rtol=0, atol=1e-11, err_msg=f"{name} at {t}")
            fmu.doStep(t, times[k + 1] - t)


def hybrid_in_process(systems, duration):
    diagram = Diagram("around")
    inner, target = diagram.add(inner=systems.hybrid(), target=Constant([0.7]))
    target >> inner.target
    ports = {name: inner.port(name) for name in ("position", "held", "force")}
    result = Simulator(diagram, step=1e-3, log=ports, log_step=5e-3).run(duration, progress=False)
    return result["time"].values, {name: np.atleast_2d(result[name].values.T).T for name in ports}


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_sampled_blocks_tick_as_time_events_of_model_exchange(version, exported, systems):
    path = exported(systems.hybrid(), version)
    result = simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        stop_time=1.0,
        output_interval=5e-3,
        relative_tolerance=1e-10,
        start_values={"target[1]": 0.7} if version == "2.0" else {"target": [0.7]},
    )
    times, expected = hybrid_in_process(systems, 1.0)
    name = "position[1]" if version == "2.0" else "position"
    found = {round(float(row["time"]), 6): np.ravel(row[name])[0] for row in result}
    for t, value in zip(times, expected["position"][:, 0], strict=True):
        assert found[round(float(t), 6)] == pytest.approx(value, abs=2e-7), t


class Wave(Block):
    """A force that swings."""

    y = Output(1, unit="N")

    def output(self, t, x, u, p):
        return {"y": np.stack([np.sin(9 * t)])}


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_block_without_states(version, kind, exported, systems):
    path = exported(systems.Wide(), version)
    name = "y[3]" if version == "2.0" else "y"
    result = simulate_fmu(str(path), fmi_type=kind, stop_time=0.1, start_values={"u": 0.3}, output=[name])
    value = result[name][-1] if version == "2.0" else result[name][-1][2]
    assert value == pytest.approx(np.sin(0.6), abs=1e-15)


def test_many_steps_added_up_stay_on_the_grid(exported, tmp_path, fmi, systems):
    """An importer that adds 0.001 a hundred thousand times makes errors of 1e-9 in time."""
    path = exported(systems.hybrid(), "2.0")
    refs = variables(path)
    expected = hybrid_in_process(systems, 100.0)[1]["position"][-1]
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu, {refs["target"]: [0.7]})
        time = 0.0
        for _ in range(100_000):
            fmu.doStep(time, 0.001)
            time += 0.001
        assert time != 100.0
        found = fmi.read(fmu, refs["position"], 1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_a_run_may_start_at_any_time(exported, tmp_path, fmi, systems):
    """What does not depend on time runs the same; instants count from the start."""
    path = exported(systems.hybrid(), "2.0")
    refs = variables(path)
    found = []
    for begin in (0.0, -2.0, 7.25):
        with fmi.opened(path, "cs", tmp_path) as fmu:
            fmi.started(fmu, begin=begin)
            for k in range(50):
                fmu.doStep(begin + 0.01 * k, 0.01)
            found.append(fmi.read(fmu, refs["position"], 1)[0])
    assert found == pytest.approx([found[0]] * 3, abs=1e-12)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_jumps_are_time_events(version, exported):
    """A step in the force at a time that no communication point hits."""
    diagram = Diagram("jump")
    force, integral = diagram.add(force=Step(1 / 3, final_value=6.0), integral=Integrator())
    force >> integral
    diagram.expose(y=integral.y)
    path = exported(diagram, version)
    result = simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        stop_time=1.0,
        output_interval=0.1,
        relative_tolerance=1e-6,
        record_events=True,
    )
    assert result["y"][-1] == pytest.approx(4.0, abs=1e-9)
    assert 1 / 3 in result["time"]


@pytest.mark.parametrize("jump", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_jump_where_a_step_ends_belongs_to_the_step_after(version, jump, exported, tmp_path, fmi):
    """Also before time 0, and at it: the integral of a unit step is exact."""
    diagram = Diagram("unit step")
    force, integral = diagram.add(force=Step(jump), integral=Integrator())
    force >> integral
    diagram.expose(y=integral.y)
    path = exported(diagram, version, f"unit step at {jump}", step=0.1)
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu, begin=-1.0)
        for k in range(5):
            fmu.doStep(-1.0 + 0.4 * k, 0.4)
        found = fmi.read(fmu, variables(path)["y"], 1)[0]
    assert found == pytest.approx(1.0 - jump, abs=1e-14)


def test_both_versions_give_the_same_numbers(exported, tmp_path, fmi, systems):
    found = []
    for version in ("2.0", "3.0"):
        path = exported(systems.hybrid(), version)
        refs = variables(path)
        with fmi.opened(path, "cs", tmp_path) as fmu:
            fmi.started(fmu, {refs["target"]: [0.7]})
            for k in range(100):
                fmu.doStep(0.01 * k, 0.01)
            names = ("position", "held", "force", "der(plant.v)")
            found.append([float(fmi.read(fmu, refs[n], 1)[0]) for n in names])
    assert found[0] == found[1]


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_jump_of_what_is_sampled_is_told(version, exported, tmp_path, fmi, systems):
    """Some importers begin integration anew only where a state is said to have changed."""
    with fmi.opened(exported(systems.hybrid(), version), "me", tmp_path) as fmu:
        fmi.started(fmu)
        said = []
        for time in (0.0, 0.005, 0.01, 0.02, 0.03, 0.04, 0.06):  # ticks every 20 ms, and 10 + k 50 ms
            if time:
                fmu.setTime(time)
                fmu.enterEventMode()
            said.append(bool(update(fmu)[3]))
            fmu.enterContinuousTimeMode()
    assert said[1:] == [False, True, True, False, True, True]
