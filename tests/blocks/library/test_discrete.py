"""Sampled blocks obey their recurrences, sample by sample."""

import control
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.blocks import (
    DiscreteTransferFunction,
    Ramp,
    UnitDelay,
    ZeroOrderHold,
    from_control,
    sampled_delay,
)

ROUND_OFF = 1e-12


def test_unit_delay_shifts_by_one_sample(respond):
    block = UnitDelay(0.1, [-1.0, -2.0])
    result = respond(block, 1.0, {"log_step": 0.1}, u=Ramp([1.0, 2.0]))
    y = result["block.y"].values
    assert_array_equal(y[0], [-1.0, -2.0])
    assert_near(y[1:], result["u_source.y"].values[:-1], ROUND_OFF)


@pytest.mark.parametrize("delay", [0.0, 0.005, 0.02, 0.03, 0.047])
def test_sampled_delay_is_exact(delay, respond):
    """y(t) = u(k T) from k T + delay on, whether or not the delay is a whole number of samples."""
    block = sampled_delay(0.02, delay, -1.0)
    log = {"y": block.y, "u": "block.hold.u"}
    result = respond(
        block,
        0.5,
        {"step": 1e-3, "log_step": 1e-3, "log": log},
        u=Ramp(1.0, initial_value=3.0),
    )
    ticks, late = np.arange(501), round(delay * 1000)
    expected = np.where(ticks < late, -1.0, 3.0 + (ticks - late) // 20 * 0.02)
    assert_near(result["y"], expected, ROUND_OFF)


def test_hold_keeps_the_last_sample(respond):
    result = respond(ZeroOrderHold(0.2, offset=0.05), 1.0, u=Ramp(start_time=-1.0))
    k = np.arange(101)
    last = np.where(k < 5, np.nan, 5 + (k - 5) // 20 * 20)
    expected = np.where(k < 5, 0.0, 1.0 + 0.01 * last)
    assert_near(result["block.y"], expected, ROUND_OFF)


def test_state_space_agrees_with_python_control(respond):
    system = control.ss(
        [[0.9, 0.1], [-0.2, 0.8]],
        [[0.0, 1.0], [1.0, 0.0]],
        [[1.0, 0.5]],
        [[0.2, 0.0]],
        0.1,
    )
    x0 = [1.0, -1.0]
    result = respond(
        from_control(system, initial_value=x0),
        3.0,
        {"log_step": 0.1},
        u=Ramp([1.0, -2.0]),
    )
    inputs = result["u_source.y"].values.T
    reference = control.forced_response(system, result["time"].values, inputs, x0)
    assert_near(result["block.y"][:, 0], reference.outputs[0], ROUND_OFF)


def test_transfer_function_agrees_with_python_control(respond):
    block = DiscreteTransferFunction([0.5, 0.2], [2.0, -1.0, 0.4], sample_time=0.1)
    result = respond(block, 2.0, {"log_step": 0.1}, u=1.0)
    system = control.tf([0.5, 0.2], [2.0, -1.0, 0.4], 0.1)
    response = control.step_response(system, result["time"].values)
    same = respond(from_control(system), 2.0, {"log_step": 0.1}, u=1.0)
    for each in (result, same):
        assert_near(each["block.y"], response.outputs, ROUND_OFF)
