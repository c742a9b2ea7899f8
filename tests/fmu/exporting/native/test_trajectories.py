"""Native FMUs give the trajectories of the block itself, for any importer."""

from itertools import pairwise

import campaign
import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu
from systems import assert_near, series, simulate_block

from trussflow.blocks import Constant, Gain, Integrator, Step

ROUND_OFF = 1e-10
"""Sums in another order, over hundreds of steps."""


def in_process(block, value, duration, **log):
    """Run a block with its input held constant, by RK4; log its outputs."""
    held = {block.only_input().name: Constant(value)}
    return simulate_block(
        block, duration, held, step=1e-3, backend="interpreted", **log
    )


def test_plant_co_simulation_equals_in_process_rk4(plant, plant_fmu, instance):
    """Forces and torques move every coordinate; rounding errors reach 6e-12 then.

    Ten times as much makes joints spin so fast that they grow to 1.1e-10 in speeds.
    """
    assert validate_fmu(str(plant_fmu)) == []
    force = np.random.default_rng(5).uniform(-0.1, 0.1, 52)
    expected = in_process(plant, force, 0.1)
    one = instance(plant_fmu).start({"actuation": force})
    one.step(0, 10, 0.01)
    for port in plant.outputs():
        last = np.ravel(expected[f"block.{port.name}"][-1].values)
        scale = max(1.0, np.abs(last).max())
        assert_near(one.get(port.name), last, ROUND_OFF * scale, err_msg=port.name)


def update(one):
    """Let an instance in event mode update its discrete states."""
    return one.newDiscreteStates() if one.scalar else one.updateDiscreteStates()


@pytest.mark.parametrize("step", [1e-3, 4e-3, 0.1])
def test_communication_steps_do_not_matter(step, version, exported, instance, systems):
    expected = in_process(systems.Oscillator(2), np.array([0.3, 0.0]), 1.0)
    one = instance(exported(systems.Oscillator(2), version, "two")).start(
        {"force": [0.3, 0.0]}
    )
    one.step(0, round(1.0 / step), step)
    assert_near(one.get("position"), expected["block.position"][-1], 1e-13)


def test_steps_off_the_grid_keep_the_order_of_the_method(exported, instance, systems):
    one = instance(exported(systems.Oscillator(2), "2.0", "coarse", step=0.05)).start()
    exact = in_process(systems.Oscillator(2), np.zeros(2), 1.0)["block.position"][-1]
    for begin, end in pairwise([0.0, 0.013, 0.07, 0.5, 0.5001, 0.93, 1.0]):
        one.doStep(begin, end - begin)
    assert_near(one.get("position"), exact, 2e-6)


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_a_block_without_states(version, kind, exported):
    result = simulate_fmu(
        str(exported(Gain(2.0), version)),
        fmi_type=kind,
        stop_time=0.1,
        start_values={"u": 0.3},
        output=["y"],
    )
    assert result["y"][-1] == 0.6


@pytest.mark.parametrize("steps, error", [(1000, 1e-12), campaign.only(100_000, 0.0)])
def test_many_steps_added_up_stay_on_the_grid(
    steps, error, exported, instance, systems
):
    """An importer that adds 0.001 a hundred thousand times makes errors of 1e-9 in time."""
    log = {"log": {"y": "block.plant.position"}, "log_step": 0.005}
    expected = in_process(systems.hybrid(), [0.7], steps * 0.001, **log)["y"][-1]
    one = instance(exported(systems.hybrid(), "2.0")).start({"target": 0.7})
    time = 0.0
    for _ in range(steps):
        one.doStep(time, 0.001)
        time += 0.001 + error
    assert_near(one.get("position"), expected, 1e-12)


def test_a_run_may_start_at_any_time(exported, instance, systems):
    """Equations without time give the same run; instants count from the start."""
    path, found = exported(systems.hybrid(), "2.0"), []
    for begin in (0.0, -2.0, 7.25):
        one = instance(path).start(begin=begin)
        for k in range(50):
            one.doStep(begin + 0.01 * k, 0.01)
        found.append(one.get("position")[0])
    assert found == pytest.approx([found[0]] * 3, abs=1e-12)


def stepping(jump):
    """Return the integral of a step."""
    diagram = series("jump", force=Step(jump), integral=Integrator())
    diagram.expose(y=diagram.integral.y)
    return diagram


@pytest.mark.parametrize(
    "version, jump", [("2.0", -0.5), ("2.0", 0.0), ("2.0", 0.5), ("3.0", 0.0)]
)
def test_a_jump_where_a_step_ends_belongs_to_the_step_after(
    version, jump, exported, instance
):
    """Also before time 0, and at it: the integral of a unit step is exact."""
    path = exported(stepping(jump), version, f"unit step at {jump}", step=0.1)
    one = instance(path).start(begin=-1.0)
    for k in range(5):
        one.doStep(-1.0 + 0.4 * k, 0.4)
    assert one.get("y") == pytest.approx(1.0 - jump, abs=1e-14)


def test_a_jump_of_a_sampled_signal_is_reported(version, exported, instance, systems):
    """Some importers restart the integration only where the FMU reports a changed state."""
    one = instance(exported(systems.hybrid(), version), "me").start()
    reported = []
    for time in (0.0, 0.005, 0.01, 0.02, 0.03, 0.04, 0.06):
        # ticks every 20 ms, and 10 + k 50 ms
        if time:
            one.setTime(time)
            one.enterEventMode()
        reported.append(bool(update(one)[3]))
        one.enterContinuousTimeMode()
    assert reported[1:] == [False, True, True, False, True, True]
