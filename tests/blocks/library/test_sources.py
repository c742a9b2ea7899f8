"""Sources follow their formulas, and adaptive solvers stop where they are not smooth."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from trussflow.blocks import (
    BlockError,
    Chirp,
    Constant,
    Diagram,
    Gain,
    Ground,
    Integrator,
    ParameterError,
    Ramp,
    Sine,
    Step,
    simulate,
)

Evaluate = Callable[..., dict[str, Any]]
ROUND_OFF = 1e-12


def played(block, times, evaluate):
    """Return the output of a source at given times."""
    return np.array([evaluate(block, t)["y"] for t in times])


def test_constant_has_its_value_shape_unit_and_frame(evaluate):
    block = Constant([1.0, 2.0], unit=("m", "rad"), frame="truss")
    np.testing.assert_array_equal(evaluate(block)["y"], [1.0, 2.0])
    assert block.y.shape == (2,)
    assert block.y.unit == ("m", "rad")
    assert block.y.frame == "truss"


def test_step_has_its_final_value_from_its_time_on(evaluate):
    block = Step(2.0, initial_value=[1.0, 0.0], final_value=3.0)
    np.testing.assert_array_equal(
        played(block, [0.0, 1.999, 2.0, 5.0], evaluate), [[1, 0], [1, 0], [3, 3], [3, 3]]
    )


def test_ramp_grows_from_its_start_time_on(evaluate):
    block = Ramp(0.5, start_time=1.0, initial_value=2.0)
    np.testing.assert_allclose(played(block, [0.0, 1.0, 3.0], evaluate), [2.0, 2.0, 3.0], rtol=ROUND_OFF)


def test_sine_has_amplitude_frequency_phase_and_bias(evaluate):
    times = np.linspace(0.0, 2.0, 101)
    block = Sine(3.0, 2.0, phase=0.3, bias=1.0)
    expected = 1.0 + 3.0 * np.sin(4 * np.pi * times + 0.3)
    np.testing.assert_allclose(played(block, times, evaluate), expected, rtol=0, atol=ROUND_OFF)


def test_chirp_has_the_integral_of_its_frequency_as_phase(evaluate):
    times = np.linspace(0.0, 6.0, 601)
    frequency = 0.5 + (3.0 - 0.5) * np.minimum(times / 4.0, 1.0)
    # The trapezoidal rule is exact for a frequency that is piecewise linear.
    phase = 2 * np.pi * cumulative_trapezoid(frequency, times, initial=0)
    block = Chirp(0.5, 3.0, 4.0, amplitude=2.0)
    np.testing.assert_allclose(
        played(block, times, evaluate), 2.0 * np.sin(phase), rtol=0, atol=1e-10
    )  # phase to 1e-12 of 80 rad


def test_ground_is_zero_in_the_shape_and_unit_asked_for(respond):
    result = respond(Gain([1.0, 1.0, 1.0], input_unit="N"), 0.01, u=Ground())
    np.testing.assert_array_equal(result["block.y"], np.zeros((2, 3)))
    assert result["u_source.y"].attrs["units"] == "N"


@pytest.mark.parametrize("backend", ["numpy", "interpreted", "compiled"])
@pytest.mark.parametrize(("step", "time"), [(0.1, 0.3), (0.3, 0.9), (0.01, 0.57), (1 / 3, 1.0)])
def test_a_jump_between_two_fixed_steps_is_exact(step, time, backend):
    """The step before sees the old value only, the one after the new one.

    3 * 0.1 rounds up, to more than 0.3, and 3 * 0.3 down, to less than 0.9.
    """
    diagram = Diagram("jump")
    jump, integral = diagram.add(jump=Step(time), integral=Integrator())
    jump >> integral
    result = simulate(diagram, 6 * time, step=step, backend=backend, progress=False)
    expected = np.maximum(result["time"] - time, 0.0)
    np.testing.assert_allclose(result["integral.y"], expected, rtol=0, atol=ROUND_OFF)
    assert time in result["time"]
    assert float(result["jump.y"].sel(time=time)) == 1.0


def test_adaptive_solvers_stop_where_sources_are_not_smooth():
    diagram = Diagram("smooth between breakpoints")
    for name, source in {"step": Step(1 / 3), "ramp": Ramp(start_time=0.4)}.items():
        integral = diagram.add(**{name: source, f"{name}_integral": Integrator()})[1]
        diagram.connect(source.y, integral.u)
    result = simulate(
        diagram, 1.0, solver="RK45", rtol=1e-3, backend="interpreted", log_step=0.5, progress=False
    )
    # Between breakpoints these are polynomials that RK45 integrates exactly at any tolerance.
    assert float(result["step_integral.y"][-1]) == pytest.approx(2 / 3, abs=ROUND_OFF)
    assert float(result["ramp_integral.y"][-1]) == pytest.approx(0.6**2 / 2, abs=ROUND_OFF)
    assert Chirp(0.0, 1.0, 0.7).breakpoints() == (0.7,)


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: Step(np.nan), BlockError, "'time' of Step is not finite: nan"),
        (
            lambda: Ramp(start_time="now"),  # type: ignore[arg-type]
            BlockError,
            "'start_time' of Ramp must be numeric, not 'now'",
        ),
        (lambda: Chirp(1, 2, 0.0), BlockError, "'duration' of Chirp is 0; it must be above 0"),
        (
            lambda: Sine([1.0, 2.0], [1.0, 2.0, 3.0]),
            ParameterError,
            r"'frequency' of Sine has shape \(3,\); it must have shape \(2,\)",
        ),
        (lambda: Constant("three"), ParameterError, "'value' of Constant must be numeric"),
    ],
)
def test_nonsense_is_refused(build, error, message):
    with pytest.raises(error, match=message):
        build()
