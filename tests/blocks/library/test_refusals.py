"""Values that blocks refuse when they are made, and the messages of these errors."""

import control
import numpy as np
import pytest
from refused import check_refused, over_calls

from trussflow.blocks import (
    ConventionalSlidingMode,
    Input,
    IntegralSlidingMode,
    Output,
    ShapedTrajectory,
    errors,
)

A, B, C = np.eye(3), np.ones((3, 2)), np.ones((2, 3))
PLANT = control.ss(np.eye(2), np.eye(2), np.eye(2), 0.0)
TWO_BY_TWO = control.tf([[[1.0], [1.0]]] * 2, [[[1.0, 1.0]] * 2] * 2)
GAINS = {
    "gamma": 1.0,
    "mu": 0.25,
    "beta": 0.9,
    "eta": 0.001,
    "sigma": 0.3,
    "boundary_layer": 1e-3,
}
u, y = {"u": Input()}, {"y": Output()}


def integral(**gains):
    return IntegralSlidingMode(**{**GAINS, **gains})


def conventional(slope=1.0, eta=1.0, **gains):
    return ConventionalSlidingMode(slope=slope, eta=eta, **gains)


def shaped(trajectory=1.0, frequency=0.4, **settings):
    return ShapedTrajectory(trajectory, frequency, **settings)


@over_calls(__file__)
def test_refused_arguments(call, error, message):
    check_refused(call, error, message, globals())


@pytest.mark.parametrize("name", GAINS)
def test_gains_of_sliding_modes_are_positive(name):
    with pytest.raises(errors.ParameterError, match=f"'{name}' of .* is -1"):
        integral(**{name: -1.0})
