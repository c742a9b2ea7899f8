"""Step doubling keeps the tolerance, rejects steps without a trace, and reports when it cannot."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.linalg import expm
from systems import ring

from trussflow.blocks import (
    CoSimulator,
    Diagram,
    Function,
    Integrator,
    StateSpace,
    Step,
    Sum,
    cosimulate,
)
from trussflow.blocks.cosimulation.step_control import StepControl
from trussflow.blocks.errors import DivergenceError, SimulationError

SMALLEST = 2.0**-14  # s
END = 4.0  # s


@pytest.fixture(scope="module", autouse=True)
def interpreted():
    """Compile, other than the rest of the folder: the smallest steps are many."""


def stiff_and_slow(units=lambda block: block):
    """Return a fast and a slow part: steps grow by a factor of a hundred on the way."""
    return ring(
        a=units(StateSpace([[-20.0]], [[10.0]], [[1.0]], [[0.0]], initial_value=[1.0])),
        b=units(StateSpace([[-0.5]], [[-1.0]], [[1.0]], [[0.0]], initial_value=[1.0])),
    )


WHOLE = np.array([[-20.0, 10.0], [-1.0, -0.5]])


def largest_error(result):
    exact = np.array(
        [expm(WHOLE * time) @ [1.0, 1.0] for time in result["time"].values]
    )
    return abs(np.column_stack([result["a.y"], result["b.y"]]) - exact).max()


@pytest.mark.parametrize(
    "coupling, tolerance", [("jacobi", 0.03), ("gauss-seidel", 0.03), ("iterate", 0.1)]
)
def test_the_error_stays_below_the_tolerance(coupling, tolerance):
    schemes = {"coupling": coupling, "tolerance": tolerance}
    result = cosimulate(
        stiff_and_slow(), END, step=SMALLEST, members=["a", "b"], **schemes
    )
    t = result["time"].values
    # Signals are of size one, and steps are no shorter than necessary.
    assert tolerance / 300 < largest_error(result) < tolerance
    steps = np.diff(t)
    assert t[0] == 0.0
    assert t[-1] == END
    assert steps.max() > 8 * steps.min()
    assert result.attrs["communication_steps"] == len(steps)


def kicked(coupling):
    """Return a run with a step in its middle, which long steps run into."""
    diagram = Diagram("kicked")
    kick, total, a, b = diagram.add(
        kick=Step(1.0, final_value=5.0),
        total=Sum("++"),
        a=StateSpace([[-3.0]], [[1.0]], [[1.0]], [[0.0]], initial_value=[1.0]),
        b=StateSpace([[0.0, 1.0], [-4.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]),
    )
    kick >> total.u1
    b.y[0] >> total.u2
    total.y >> a.u[0]
    a.y >> b.u
    return CoSimulator(
        diagram, step=2.0**-11, members=["a", "b"], coupling=coupling, tolerance=3e-2
    )


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel", "iterate"])
def test_a_discarded_step_leaves_no_trace(coupling, monkeypatch):
    """The accepted steps alone, taken by another master, give the same run to the last bit."""
    result = kicked(coupling).run(2.0)
    assert result.attrs["rejected_steps"] > 0
    assert result.attrs["communication_steps"] > 20

    points = np.round(result["time"].values * 2**12).astype(int)

    def replay(self, _last, reached):
        for number in np.diff(points):
            self.coupled.step(int(number))
            reached()

    monkeypatch.setattr(StepControl, "run", replay)
    again = kicked(coupling).run(2.0)
    for name in ("a.y", "b.y", "total.y"):
        assert_array_equal(again[name].values, result[name].values)
    assert_array_equal(again["time"], result["time"])


def test_steps_that_a_member_refuses_are_shortened(stepping):
    longest = 2.0**-5

    def choosy(block):
        return stepping(block, 2.0**-13, longest=longest)

    result = cosimulate(stiff_and_slow(choosy), 1.0, step=2.0**-12, tolerance=0.05)
    assert result.attrs["discarded_steps"] > 0
    assert np.diff(result["time"]).max() <= longest
    assert largest_error(result) < 0.05
    with pytest.raises(
        SimulationError, match=r"step of 0\.03125 s is too long.*fixed.*tolerance"
    ):
        cosimulate(
            stiff_and_slow(lambda b: stepping(b, 0.03125, longest=0.01)),
            1.0,
            step=0.03125,
        )
    with pytest.raises(
        SimulationError, match=r"too long.*smallest step of 0\.5 s: shorter steps"
    ):
        cosimulate(
            stiff_and_slow(lambda b: stepping(b, 0.25, longest=0.01)),
            1.0,
            step=0.5,
            tolerance=1.0,
        )


def test_a_tolerance_that_cannot_be_kept_ends_the_run_with_its_log():
    with pytest.raises(
        SimulationError, match=r"cannot keep the tolerance at t = .*'[ab]\.y'"
    ) as caught:
        cosimulate(stiff_and_slow(), 4.0, step=2.0**-4, members=["a"], tolerance=1e-6)
    assert caught.value.result.attrs["status"] == "failed"


def test_divergence_in_a_trial_is_a_rejection_until_the_step_is_the_smallest():
    def blow_up(limit):
        jump = Function(lambda u: np.where(np.abs(u) < limit, -40.0 * u, np.inf))
        return ring(a=Integrator(1.0), b=jump)

    result = cosimulate(
        blow_up(1.5), 0.5, step=2.0**-12, members=["a"], tolerance=0.1, largest_step=0.5
    )
    assert abs(result["a.y"][-1].item()) < 0.01
    with pytest.raises(DivergenceError, match=r"'b\.y' .*stopped being finite"):
        cosimulate(blow_up(0.5), 0.5, step=2.0**-12, members=["a"], tolerance=0.1)
