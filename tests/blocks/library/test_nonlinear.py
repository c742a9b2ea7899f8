"""Limits of size and rate."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from trussflow.blocks import (
    BlockError,
    DeadZone,
    Function,
    Input,
    Output,
    ParameterError,
    RateLimiter,
    Saturation,
    Sine,
    Step,
)

Evaluate = Callable[..., dict[str, Any]]
Respond = Callable[..., xr.Dataset]
vectors = st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=4)


@given(u=vectors, limits=st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)).map(sorted))
def test_saturation_clips_and_dead_zone_passes_the_rest(
    u: list[float], limits: list[float], evaluate: Evaluate
) -> None:
    limited = evaluate(Saturation(*limits), u=u)["y"]
    np.testing.assert_array_equal(limited, np.clip(u, limits[0], limits[1]))
    rest = evaluate(DeadZone(*limits), u=u)["y"]
    np.testing.assert_allclose(rest + limited, u, rtol=0, atol=1e-14)


@pytest.mark.parametrize("backend", ["numpy", "interpreted", "compiled"])
def test_saturation_does_not_hide_nan(backend: str, respond: Respond) -> None:
    """The minimum of CasADi's interpreter would: of a number and NaN it returns the number."""
    undefined = Function(lambda u: np.sqrt(u - 1.0), {"u": Input(default=0.0)}, {"y": Output()})
    settings = {"backend": backend, "log": ["block.y"], "not_finite": "ignore"}
    with np.errstate(invalid="ignore"):
        result = respond(Saturation(-1.0, 1.0), 0.01, settings, u=undefined)
    assert np.isnan(result["block.y"]).all()


def test_limits_hold_for_each_element(evaluate: Evaluate) -> None:
    y = evaluate(Saturation([-1.0, -2.0], [1.0, 2.0]), u=[3.0, -3.0])["y"]
    np.testing.assert_array_equal(y, [1.0, -2.0])


def test_rate_limiter_ramps_after_a_step(respond: Respond) -> None:
    steps = Step(0.5, initial_value=[1.0, 2.0], final_value=[2.0, 1.0])
    result = respond(RateLimiter(2.0, 0.1, falling=1.0), 2.0, {"log_step": 0.1}, u=steps)
    moving = np.maximum(np.linspace(0.0, 2.0, 21) - 0.4, 0.0)  # the sample at 0.5 moves already
    up, down = np.minimum(1.0 + 2.0 * moving, 2.0), np.maximum(2.0 - moving, 1.0)
    np.testing.assert_allclose(result["block.y"], np.stack([up, down], axis=1), rtol=0, atol=1e-12)


def test_rate_limiter_passes_what_is_slow_enough(respond: Respond) -> None:
    result = respond(RateLimiter(2 * np.pi, 0.01), 1.0, u=Sine(1.0, 1.0))
    np.testing.assert_allclose(result["block.y"], result["u_source.y"], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: Saturation(1.0, -1.0), ParameterError, "'lower' of Saturation is 1.0, but 'upper'"),
        (lambda: DeadZone([0, 1], [1, 1, 1]), ParameterError, r"'upper' of DeadZone has shape \(3,"),
        (lambda: RateLimiter(-1.0, 0.1), ParameterError, "'rising' of RateLimiter is -1"),
        (lambda: RateLimiter(1.0, np.inf), BlockError, "cannot sample 'RateLimiter' every inf s"),
    ],
)
def test_nonsense_is_refused(build: Callable[[], object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        build()
