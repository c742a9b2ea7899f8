"""What units remember (discrete states, and what Python blocks hide) goes back with them."""

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Diagram,
    DiscreteStateSpace,
    Input,
    Integrator,
    Output,
    Running,
    SimulationError,
    StateSpace,
    cosimulate,
)

H = 0.125  # s


class TotalRun(Running):
    def __init__(self):
        self.kept = 0.0

    def output(self, t, x, u, p):
        return {"y": self.kept}

    def update(self, t, x, u, p):
        self.kept += float(u.u)
        return {}


class TotalRunThatGoesBack(TotalRun):
    def save(self):
        return self.kept

    def restore(self, saved):
        self.kept = saved


class Total(Block):
    """A Python block that keeps its sum where the framework cannot see it."""

    traced = False
    u = Input()
    y = Output()

    def open(self, p):
        return TotalRunThatGoesBack()

    def feedthrough(self):
        return {"y": ()}


class Forgetful(Total):
    """One that cannot hand over what it keeps."""

    def open(self, p):
        return TotalRun()


def diagram(total):
    """Return a continuous loop of two units; one sums up what it sees of the other."""
    found = Diagram("summing")
    found.add(
        a=StateSpace([[-1.0]], [[2.0]], [[1.0]], [[0.0]], initial_value=[1.0]), b=Integrator(0.5), total=total
    )
    found.connect(found.a.y[0], found.b.u)
    found.connect(found.b.y, found.a.u[0])
    found.connect(found.a.y[0], total.port("u"))
    return found


def discrete():
    return DiscreteStateSpace([[1.0]], [1.0], [1.0], 0.0, sample_time=H)


def hidden():
    return Total().sampled(every=H)


@pytest.mark.parametrize("make", [discrete, hidden])
@pytest.mark.parametrize("units", [["a"], ["a", "total"], ["a", "b"]])
@pytest.mark.parametrize(
    "settings",
    [
        {"coupling": "jacobi"},
        {"coupling": "gauss-seidel"},
        {"coupling": "iterate"},
        {"coupling": "iterate", "extrapolation": 1},
        {"tolerance": 0.3, "largest_step": H},
    ],
)
def test_sums_are_sums(make, units, settings):
    """Whatever the scheme makes of the loop, each instant is counted once, with its own value."""
    result = cosimulate(diagram(make()), 2.0, members=units, **({"step": H} | settings), solver_step=H / 8)
    seen = result["a.y"].sel(time=np.arange(0.0, 2.0, H))[:, 0]
    expected = np.concatenate([[0.0], np.cumsum(seen)])[:16]
    at = np.arange(0.0, 2.0, H)
    found = result["total.y"].values.ravel()[np.searchsorted(result["time"], at)]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_what_cannot_go_back_is_named():
    block = Forgetful().sampled(every=H)
    with pytest.raises(SimulationError, match=r'couple with "iterate".*state: \'the rest\';'):
        cosimulate(diagram(block), 1.0, step=H, members=["a"], coupling="iterate")
