"""Limits of size and rate."""

import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.blocks import (
    ConventionalSlidingMode,
    DeadZone,
    Function,
    Input,
    Output,
    Quantizer,
    RateLimiter,
    Saturation,
    Sine,
    Step,
)

vectors = st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=4)


@given(
    u=vectors, limits=st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)).map(sorted)
)
def test_saturation_clips_and_dead_zone_passes_the_rest(u, limits, evaluate):
    limited = evaluate(Saturation(*limits), u=u)["y"]
    assert_array_equal(limited, np.clip(u, limits[0], limits[1]))
    rest = evaluate(DeadZone(*limits), u=u)["y"]
    assert_near(rest + limited, u, 1e-14)


LAYER = ConventionalSlidingMode(slope=2.0, eta=1.0, boundary_layer=0.1)


@pytest.mark.parametrize(
    "block, port, shown",
    [(Saturation(-1.0, 1.0), "u", "y"), (LAYER, "position", "feedback")],
)
def test_limits_do_not_hide_nan(block, port, shown, backend, respond):
    """The minimum of CasADi's interpreter would: of a number and NaN it returns the number."""
    undefined = Function(
        lambda u: np.sqrt(u - 1.0), {"u": Input(default=0.0)}, {"y": Output()}
    )
    settings = {"backend": backend, "log": [f"block.{shown}"], "not_finite": "ignore"}
    inputs = {each.name: 0.0 for each in block.inputs()} | {port: undefined}
    with np.errstate(invalid="ignore"):
        result = respond(copy.deepcopy(block), 0.01, settings, **inputs)
    assert np.isnan(result[f"block.{shown}"]).all()


def test_quantizer_does_not_hide_nan(evaluate):
    assert np.isnan(
        evaluate(Quantizer(0.1, 0.01), states={"previous": 0.0}, u=np.nan)["y"]
    )


def test_limits_hold_for_each_element(evaluate):
    y = evaluate(Saturation([-1.0, -2.0], [1.0, 2.0]), u=[3.0, -3.0])["y"]
    assert_array_equal(y, [1.0, -2.0])


def test_rate_limiter_ramps_after_a_step(respond):
    steps = Step(0.5, initial_value=[1.0, 2.0], final_value=[2.0, 1.0])
    result = respond(
        RateLimiter(2.0, 0.1, falling=1.0), 2.0, {"log_step": 0.1}, u=steps
    )
    # the sample at 0.5 moves already
    moving = np.maximum(np.linspace(0.0, 2.0, 21) - 0.4, 0.0)
    up, down = np.minimum(1.0 + 2.0 * moving, 2.0), np.maximum(2.0 - moving, 1.0)
    assert_near(result["block.y"], np.stack([up, down], axis=1), 1e-12)


@given(u=vectors, previous=st.integers(-30, 30), quantum=st.floats(0.01, 3.0))
def test_quantizer_errs_by_half_a_quantum(u, previous, quantum, evaluate):
    states = {"previous": previous * quantum}
    y = evaluate(Quantizer(quantum, 0.1), states=states, u=u)["y"]
    assert_near(y, u, quantum / 2 * (1 + 1e-12))
    assert_near(y / quantum, np.rint(y / quantum), 1e-9)


def test_quantizer_has_hysteresis_and_a_smallest_value(respond):
    result = respond(Quantizer(0.5, 0.01, hysteresis=0.3), 2.0, u=Sine(0.999, 0.5))
    y, u = result["block.y"].values, result["u_source.y"].values
    rises = np.flatnonzero(np.diff(y) > 0)
    assert len(rises) == 4
    for k in rises:
        assert u[k] <= y[k] + 0.8 * 0.5 < u[k + 1]
    block = Quantizer(0.1, 0.01, smallest=0.3)
    y = respond(block, 2.0, u=Sine(0.999, 0.5))["block.y"].values
    assert set(np.abs(y).round(9)) == {0.0, *(np.arange(3, 11) / 10)}
