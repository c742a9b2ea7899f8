"""Discrete states and hidden states of Python blocks go back with their members."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import HiddenSum, HiddenSumRun, assert_near

from trussflow.blocks import (
    Diagram,
    DiscreteStateSpace,
    Function,
    Integrator,
    StateSpace,
    cosimulate,
)
from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.run_state import Running

H = 0.125  # s


class ForgetfulRun(HiddenSumRun):
    save = Running.save
    restore = Running.restore


class Forgetful(HiddenSum):
    """A Python block whose hidden sum cannot be saved."""

    def open(self, p):
        return ForgetfulRun(1)


def summing(total):
    """Return a continuous loop of two blocks; a third sums the tanh of the first."""
    diagram = Diagram("summing")
    a, b, total = diagram.add(
        a=StateSpace([[-1.0]], [[2.0]], [[1.0]], [[0.0]], initial_value=[1.0]),
        b=Integrator(0.5),
        total=total,
    )
    a.y[0] >> b.u
    b.y >> a.u[0]
    if isinstance(total, HiddenSum):
        a.y >> total.u
    else:
        a.y >> diagram.add("tanh", Function(np.tanh)) >> total.u
    return diagram


def discrete():
    return DiscreteStateSpace([[1.0]], [[1.0]], [[1.0]], [[0.0]], sample_time=H)


def hidden():
    return HiddenSum().sampled(every=H)


@pytest.mark.parametrize(
    "make, members",
    [
        (discrete, ["a"]),
        (discrete, ["a", "total"]),
        (hidden, ["a", "total"]),
        (hidden, ["a", "b"]),
    ],
)
@pytest.mark.parametrize(
    "settings",
    [
        {"coupling": "jacobi"},
        {"coupling": "gauss-seidel"},
        {"coupling": "iterate"},
        {"tolerance": 0.3, "largest_step": H},
    ],
)
def test_each_instant_is_summed_once(make, members, settings):
    """Each sample counts with its final value in every scheme, whatever the error of the loop."""
    result = cosimulate(
        summing(make()), 2.0, members=members, step=H, solver_step=H / 8, **settings
    )
    samples = result.sel(time=np.arange(0.0, 2.0, H))
    expected = np.cumsum(np.tanh(samples["a.y"]))
    assert_near(samples["total.y"][0], 0.0, 1e-15)
    assert_allclose(samples["total.y"][1:], expected[:-1], rtol=1e-9)


def test_member_that_cannot_go_back_is_named():
    block = Forgetful().sampled(every=H)
    with pytest.raises(
        SimulationError, match=r'couple with "iterate".*state: \'the rest\';'
    ):
        cosimulate(summing(block), 1.0, step=H, members=["a"], coupling="iterate")
