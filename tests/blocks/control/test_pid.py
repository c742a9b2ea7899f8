"""PID control: its law against python-control, its limits, its start, and its samples."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import assert_near

from trussflow.blocks import (
    PID,
    Constant,
    Diagram,
    DiscretePID,
    Ramp,
    Step,
    TransferFunction,
    linearize,
    simulate,
)

ROUND_OFF = 1e-9


@pytest.mark.parametrize("b, c", [(1.0, 0.0), (0.3, 1.0)])
def test_transfer_functions_are_those_of_the_book(b, c):
    """From the reference kp b + ki/s + kd c s/(1 + T s), from the measurement minus that with b = c = 1."""
    pid = PID(
        2.0, 3.0, 0.5, filter_time=0.1, reference_weight=b, reference_rate_weight=c
    )
    model = linearize(pid, ["reference", "measurement"], ["y"])
    s = control.tf("s")
    omega = np.logspace(-2, 3, 30)
    for column, (weight, rate_weight) in enumerate([(b, c), (1.0, 1.0)]):
        book = 2.0 * weight + 3.0 / s + 0.5 * rate_weight * s / (1 + 0.1 * s)
        found = model[0, column](1j * omega) * (-1) ** column
        assert_allclose(found, book(1j * omega), rtol=ROUND_OFF)


def loop(pid, level=1.0):
    d = Diagram("loop")
    step, motor = d.add(
        step=Step(0.5, final_value=level),
        motor=TransferFunction([1.0], [1.0, 0.4, 0.0]),
    )
    d.add("pid", pid)
    step >> pid.reference
    pid >> motor >> pid.measurement
    return d


def test_back_calculation_shortens_the_overshoot_of_a_limited_loop():
    def overshoot(**settings):
        pid = PID(1.0, 0.5, 1.5, lower=-0.2, upper=0.2, **settings)
        result = simulate(loop(pid, 3.0), 60.0, step=0.01)
        assert abs(result["pid.y"]).max() <= 0.2
        return result["motor.y"].max() - 3.0

    assert (
        0.0
        < overshoot(back_calculation=2.0)
        < overshoot()
        < 0.3 * overshoot(back_calculation=0.0)
    )


def test_integral_settles_where_back_calculation_holds_it(respond):
    """With a constant error e, k_b (v - h) = k_i e: v settles at h + k_i e / k_b."""
    pid = PID(1.0, 2.0, upper=1.0, back_calculation=4.0)
    result = respond(
        pid, 10.0, {"log": ["block.integral"]}, reference=3.0, measurement=0.0
    )
    assert_allclose(
        result["block.integral"][-1], 1.0 + 2.0 * 3.0 / 4.0 - 3.0, rtol=ROUND_OFF
    )


@pytest.mark.parametrize(
    "build", [PID, lambda *a, **k: DiscretePID(*a, sample_time=0.01, **k)]
)
def test_start_without_a_bump(build, respond):
    pid = build(2.0, 0.5, 0.3, start=[0.7, -0.2], reference_rate_weight=1.0)
    result = respond(pid, 0.5, reference=[1.0, 2.0], measurement=[0.0, -3.0])
    assert_near(result["block.y"][0], [0.7, -0.2], ROUND_OFF)
    error = np.array([1.0, 5.0])
    assert_near(result["block.y"][-1], [0.7, -0.2] + 0.5 * error * 0.5, ROUND_OFF)


def test_sampled_law_sample_by_sample(respond):
    """The forward Euler integral of the error, and the exact samples of the filtered derivative."""
    every, settle, (kp, ki, kd) = 0.1, 0.25, (2.0, 3.0, 0.4)
    limits = {"lower": -1.0, "upper": 1.5, "back_calculation": 2.0}
    pid = DiscretePID(
        kp,
        ki,
        kd,
        sample_time=every,
        filter_time=settle,
        reference_weight=0.5,
        **limits,
    )
    result = respond(pid, 1.0, {"step": every}, reference=1.0, measurement=Ramp(2.0))
    integral = smooth = 0.0
    for k, y in enumerate(result["block.y"].values):
        measured = 2.0 * k * every
        after = smooth + (1.0 - np.exp(-every / settle)) * (-measured - smooth)
        unlimited = kp * (0.5 - measured) + integral + kd * (after - smooth) / every
        expected = np.clip(unlimited, -1.0, 1.5)
        assert y == pytest.approx(expected, abs=ROUND_OFF)
        integral += every * (ki * (1.0 - measured) - 2.0 * (unlimited - expected))
        smooth = after


def test_units_and_shapes():
    pid = PID([1.0, 2.0], unit="rad", output_unit="N*m")
    assert (pid.y.unit, pid.y.shape, pid.measurement.unit) == ("N*m", (2,), "rad")
    d = Diagram("d")
    d.add(pid=PID(1.0), source=Constant([1.0, 2.0, 3.0]))
    d.source >> d.pid.reference
    assert d.pid.y.shape == (3,)
