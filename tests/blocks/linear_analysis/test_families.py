"""Families of linear models: each is that of its parameters and of its time, exactly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import ring

from trussflow.blocks import Function, Gain, Integrator, OperatingPoint, linearize_over
from trussflow.blocks.errors import LinearAnalysisError

SETTINGS = {"step": 0.01, "backend": "interpreted"}


def decay():
    """Return x' = -k x^2 from 1: x = 1 / (1 + k t)."""
    diagram = ring(square=Function(np.square), gain=Gain(-1.0), x=Integrator(1.0))
    diagram.expose(where=diagram.x.y)
    return diagram


def test_a_family_over_parameters_and_times_has_the_exact_rates():
    """The slope along the solution is -2 k x = -2 k / (1 + k t)."""
    gains, times = [1.0, 3.0], [0.0, 0.5, 2.0]
    family = linearize_over(
        decay(),
        "x.u",
        parameters={"gain.gain": [-k for k in gains]},
        times=times,
        **SETTINGS,
    )
    assert family.dims == ("gain.gain", "time")
    for k in gains:
        for t in times:
            model = family.sel({"gain.gain": -k, "time": t}).item()
            assert model.operating_point.time == t
            assert model.A.item() == pytest.approx(-2 * k / (1 + k * t), rel=1e-8)


def test_a_family_begins_where_it_is_told_to():
    at = OperatingPoint(time=1.0, states={"x.integral": 0.25})
    family = linearize_over(decay(), "x.u", times=[1.0, 5.0], at=at, **SETTINGS)
    slopes = [model.A.item() for model in family.values]
    assert_allclose(slopes, [-0.5, -2 / 8], rtol=1e-8)
    alone = linearize_over(decay(), "x.u", at=at)
    assert alone.shape == ()
    assert alone.item().A.item() == pytest.approx(-0.5, rel=1e-12)


@pytest.mark.parametrize(
    "arguments, message",
    [
        (
            {"parameters": {"gain.gain": 2.0}},
            r"cannot linearize over 'gain\.gain' = 2\.0: give a sequence",
        ),
        ({"parameters": {"gain.gain": []}}, "give a sequence of values to try"),
        ({"times": [0.5, 0.5]}, r"they must increase, from 0 s on"),
        ({"times": [-1.0]}, r"they must increase, from 0 s on"),
        ({"times": []}, r"they must increase, from 0 s on"),
    ],
)
def test_bad_families_are_refused(arguments, message):
    with pytest.raises(LinearAnalysisError, match=message):
        linearize_over(decay(), "x.u", **arguments, **SETTINGS)
