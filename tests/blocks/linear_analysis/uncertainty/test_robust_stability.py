"""Stability of all members: proved where closed forms say so, refuted where one member is unstable."""

from itertools import product

import numpy as np
import pytest
from systems import Level

from trussflow.blocks import Block, Gain, Input, Output, Parameter, State
from trussflow.blocks.errors import LinearAnalysisError, ParameterError
from trussflow.blocks.linear_analysis.uncertainty import robust_stability, uncertain


class Chain(Block):
    """Masses between springs, and dampers in proportion to them, from wall to wall."""

    force = Input()
    position = Output()
    x = State("masses")
    v = State("masses")
    mass = Parameter(1.0)
    stiffness = Parameter(4.0)
    damping = Parameter(0.01, meaning="by stiffness")

    def __init__(self, masses=1):
        self.masses = masses
        super().__init__()

    def output(self, t, x, u, p):
        return {"position": x.x[0]}

    def derivative(self, t, x, u, p):
        n = self.masses
        springs = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
        pull = np.append(u.force, np.zeros(n - 1))
        return {
            "x": x.v,
            "v": (pull - p.stiffness * (springs @ (x.x + p.damping * x.v))) / p.mass,
        }


def chain(masses, **ranges):
    return uncertain(
        Chain(masses), "force", "position", {f"Chain.{k}": v for k, v in ranges.items()}
    )


def slowest(masses, mass, stiffness, damping):
    """Return how fast the slowest of the modes of a light chain decays: zeta omega = damping omega² / 2."""
    return (
        damping * stiffness / mass * 4.0 * np.sin(np.pi / 2 / (masses + 1)) ** 2 / 2.0
    )


LIGHT = {"stiffness": 0.1, "mass": 0.1, "damping": (0.008, 0.012)}


def test_the_decay_of_the_worst_member_is_proved_and_no_more():
    """The member of least stiffness and damping, and greatest mass, is the slowest."""
    model, least = chain(1, **LIGHT), slowest(1, 1.1, 3.6, 0.008)
    proof = robust_stability(model, decay=0.9 * least)
    assert proof.proved
    assert proof.unstable is None
    assert proof.open == 0.0
    other = robust_stability(model, decay=1.05 * least)
    assert not other.proved
    assert other.unstable is not None
    values = {
        name.removeprefix("Chain."): value for name, value in other.unstable.items()
    }
    assert slowest(1, **values) < 1.05 * least * (1.0 + 1e-3)


def test_eight_modes_of_light_damping_take_few_boxes():
    """Damping of 0.3 % at the least; with one P for a box it takes thousands for one mode."""
    proof = robust_stability(chain(8, **LIGHT), boxes=1500)
    assert proof.proved


class Island(Level):
    """Unstable for a parameter between 0.25 and 0.45 only."""

    p = Parameter(0.0)
    top = Parameter(0.01)

    def derivative(self, t, x, u, p):
        return {"x": (p.top - (p.p - 0.35) ** 2) * x.x + u.u}


def test_an_unstable_island_between_stable_corners_is_found():
    found = robust_stability(uncertain(Island(), "u", "y", {"Island.p": (-1.0, 1.0)}))
    assert not found.proved
    assert found.unstable is not None
    assert 0.25 <= found.unstable["Island.p"] <= 0.45
    assert 0.0 < found.open < 1.0
    lower = uncertain(
        Island(), "u", "y", {"Island.p": (-1.0, 1.0), "Island.top": (-0.02, -0.001)}
    )
    assert robust_stability(lower).proved


class Family(Block):
    """The rate or the next value of x is a matrix times x: M_0 + a M_1 + a b M_2."""

    u = Input()
    y = Output()
    x = State("size")
    a = Parameter(0.0)
    b = Parameter(0.0)

    def __init__(self, *matrices):
        self.matrices = matrices
        self.size = len(matrices[0])
        super().__init__()

    def output(self, t, x, u, p):
        return {"y": x.x[0]}

    def moved(self, t, x, u, p):
        factors = 1.0, p.a, p.a * p.b
        return {
            "x": sum(
                factor * M for factor, M in zip(factors, self.matrices, strict=True)
            )
            @ x.x
            + u.u
        }


class Flow(Family):
    derivative = Family.moved


class Recurrence(Family):
    update = Family.moved


def test_sampled_members_are_proved_within_the_unit_circle():
    """The poles are a (1 ± i b)."""
    block = Recurrence(
        np.zeros((2, 2)), np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])
    ).sampled(0.1)
    model = uncertain(
        block, "u", "y", {"Recurrence.a": (0.7, 0.8), "Recurrence.b": (0.4, 0.6)}
    )
    radius = 0.8 * np.hypot(1.0, 0.6)
    assert robust_stability(model, decay=-0.98 * np.log(radius) / 0.1).proved
    assert (
        robust_stability(model, decay=-1.02 * np.log(radius) / 0.1).unstable is not None
    )


@pytest.mark.parametrize("seed", range(6))
def test_no_member_contradicts_a_proof(seed):
    random = np.random.default_rng(seed)
    matrices = random.normal(size=(3, 4, 4))

    model = uncertain(
        Flow(*matrices), "u", "y", {"Flow.a": (-0.5, 0.5), "Flow.b": (-0.5, 0.5)}
    )
    members = product(np.linspace(-1.0, 1.0, 21), repeat=2)
    growth = max(
        np.linalg.eigvals(model.fractions.at(np.array(d))[:4, :4]).real.max()
        for d in members
    )
    assert robust_stability(model, decay=-growth - 0.2).proved
    assert robust_stability(model, decay=-growth + 0.05).unstable is not None


def rotated(seed, size):
    """Return a model whose two motions are far from normal: at 1 its radius is 1.3, whatever `size` is."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(2, 2)))[0]
    middle = turn @ np.array([[0.3, size], [0.0, 0.7]]) @ turn.T
    change = turn @ np.array([[0.0, 0.0], [0.6 / size, 0.0]]) @ turn.T

    return uncertain(
        Recurrence(middle, change, 0.0 * change).sampled(0.1),
        "u",
        "y",
        {"Recurrence.a": (-1.0, 1.0)},
    )


@pytest.mark.parametrize("size", [1.0, 1e2, 1e4, 3e5])
@pytest.mark.parametrize("seed", [1, 8])
def test_round_off_proves_nothing(seed, size):
    """The equation of Lyapunov is then solved to few digits, or not at all; the poles are known to more."""
    found = robust_stability(rotated(seed, size), boxes=60)
    assert not found.proved
    assert size > 1e3 or found.unstable is not None


def test_what_has_no_states_is_stable_and_no_decay_is_too_fast_to_ask_for():
    assert robust_stability(uncertain(Gain(2.0), "u", "y", {"Gain.gain": 0.1})).proved
    assert robust_stability(rotated(1, 1.0), decay=1e6).unstable is not None
    assert robust_stability(rotated(1, 1.0), decay=-1e6).proved


def test_what_boxes_do_not_decide_stays_open():
    found = robust_stability(chain(1, stiffness=0.5, mass=0.5), boxes=1)
    assert (found.proved, found.unstable, found.open, found.boxes) == (
        False,
        None,
        1.0,
        1,
    )


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        ({"boxes": 0}, LinearAnalysisError, "boxes"),
        ({"decay": np.nan}, ParameterError, "decay"),
    ],
)
def test_bad_arguments_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        robust_stability(chain(1, stiffness=0.1), **arguments)
