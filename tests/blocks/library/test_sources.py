"""Sources follow their formulas, and adaptive solvers stop where they are not smooth."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, series

from trussflow.blocks import (
    Constant,
    Diagram,
    Gain,
    Ground,
    Integrator,
    Ramp,
    Sine,
    Step,
    simulate,
)

ROUND_OFF = 1e-12


TIMES = np.linspace(0.0, 6.0, 601)


@pytest.mark.parametrize(
    "block, expected",
    [
        (Constant([1.0, 2.0]), [[1.0, 2.0]] * 601),
        (
            Step(2.0, initial_value=[1.0, 0.0], final_value=3.0),
            [[1.0, 0.0]] * 200 + [[3.0, 3.0]] * 401,
        ),
        (
            Ramp(0.5, start_time=1.0, initial_value=2.0),
            2.0 + 0.5 * np.maximum(TIMES - 1.0, 0.0),
        ),
        (
            Sine(3.0, 2.0, phase=0.3, bias=1.0),
            1.0 + 3.0 * np.sin(4 * np.pi * TIMES + 0.3),
        ),
    ],
)
def test_sources_follow_their_formulas(block, expected, evaluate):
    """Round-off of a phase of 80 rad is 1e-12 and below."""
    assert_near([evaluate(block, t)["y"] for t in TIMES], expected, 1e-11)


def test_ground_is_zero_in_the_shape_and_unit_asked_for(respond):
    result = respond(Gain([1.0, 1.0, 1.0], input_unit="N"), 0.01, u=Ground())
    assert_array_equal(result["block.y"], np.zeros((2, 3)))
    assert result["u_source.y"].attrs["units"] == "N"


@pytest.mark.parametrize(
    "step, time", [(0.1, 0.3), (0.3, 0.9), (0.01, 0.57), (1 / 3, 1.0)]
)
def test_a_jump_between_two_fixed_steps_is_exact(step, time, backend):
    """The step before sees the old value only, the one after the new one.

    3 * 0.1 rounds up, to more than 0.3, and 3 * 0.3 down, to less than 0.9.
    """
    diagram = series("jump", jump=Step(time), integral=Integrator())
    result = simulate(diagram, 6 * time, step=step, backend=backend)
    expected = np.maximum(result["time"] - time, 0.0)
    assert_near(result["integral.y"], expected, ROUND_OFF)
    assert time in result["time"]
    assert result["jump.y"].sel(time=time) == 1.0


def test_adaptive_solvers_stop_where_sources_are_not_smooth():
    diagram = Diagram("smooth between breakpoints")
    for name, source in {"step": Step(1 / 3), "ramp": Ramp(start_time=0.4)}.items():
        integral = diagram.add(**{name: source, f"{name}_integral": Integrator()})[1]
        diagram.connect(source.y, integral.u)
    result = simulate(diagram, 1.0, solver="RK45", rtol=1e-3, log_step=0.5)
    # Between breakpoints these are polynomials that RK45 integrates exactly at any tolerance.
    assert result["step_integral.y"][-1] == pytest.approx(2 / 3, abs=ROUND_OFF)
    assert result["ramp_integral.y"][-1] == pytest.approx(0.6**2 / 2, abs=ROUND_OFF)
