"""Uncertain models against exact members: nothing beyond the bounds, and the bounds are reached."""

import re
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Diagram,
    Input,
    LinearAnalysisError,
    Output,
    Parameter,
    ParameterError,
    SimulationWarning,
    State,
    ZeroOrderHold,
    uncertain,
    worst_gain,
)
from trussflow.blocks.linear_analysis.uncertainty.gain_series import GainSeries, corners
from trussflow.blocks.linear_analysis.uncertainty.worst_case import mu_bound
from trussflow.models import TrussModes, TunableTruss
from trussflow.models.truss.variations import loaded, scaled

TOLERANCE = 0.05


class Oscillator(Block):
    """A mass on a spring."""

    force = Input()
    position = Output()
    x = State(2)
    mass = Parameter(1.0)
    stiffness = Parameter(4.0)
    damping = Parameter(0.1)
    colour = Parameter(1.0, meaning="of no consequence")

    def output(self, t, x, u, p):
        return {"position": x.x[0]}

    def derivative(self, t, x, u, p):
        rate = (u.force - p.stiffness * x.x[0] - p.damping * x.x[1]) / p.mass
        return {"x": np.stack([x.x[1], rate])}


def model_of(**ranges):
    given = {f"Oscillator.{name}": value for name, value in ranges.items()}
    return uncertain(Oscillator(), "force", "position", given)


def gains(model, omega, count):
    """Return the greatest gain at each frequency among exact members, those at all corners included."""
    drawn = np.random.default_rng(7).uniform(-1.0, 1.0, (count, len(model.ranges)))
    deltas = np.vstack([drawn, list(product((-1.0, 1.0), repeat=len(model.ranges)))])
    responses = [np.abs(model.family(delta)(1j * omega, squeeze=True)) for delta in deltas]
    return np.asarray(np.max(responses, axis=0))


def test_what_is_linear_or_quadratic_in_the_parameters_is_exact():
    model = model_of(stiffness=0.2, damping=(0.05, 0.3))
    assert model.fractions.sizes == (1, 1)
    assert model.misfit < 1e-12
    exact = model.family(np.array([0.3, -0.7]))
    f = model.fractions.at(np.array([0.3, -0.7]))
    assert f[:2, :2] == pytest.approx(exact.A, abs=1e-12)
    assert model.values([0.3, -0.7])["Oscillator.stiffness"] == pytest.approx(4.0 * 1.06, rel=1e-12)


def test_a_spring_is_softest_where_its_stiffness_is_least():
    found = worst_gain(model_of(stiffness=0.2, damping=0.5), 0.0, tolerance=TOLERANCE)
    assert found.reached[0] == pytest.approx(1.0 / 3.2, rel=1e-6)
    assert found.reached[0] <= found.bound[0] <= found.reached[0] * (1.0 + TOLERANCE) * (1.0 + 1e-9)
    assert found.parameters[0]["Oscillator.stiffness"] == pytest.approx(3.2, rel=1e-6)


def test_no_member_is_beyond_the_bound_and_one_is_near():
    model = model_of(stiffness=0.1, damping=0.5, mass=0.05)
    assert model.misfit < 0.01
    omega = np.array([0.5, 1.6, 1.8, 2.0, 2.2, 5.0])
    found, sampled = worst_gain(model, omega, tolerance=TOLERANCE), gains(model, omega, 3000)
    assert np.all(sampled < found.bound)
    assert np.all(sampled > found.bound / 1.2)
    assert np.all(found.bound <= found.reached * (1.0 + TOLERANCE) * (1.0 + 1e-9))


def test_where_a_member_has_a_pole_there_is_no_bound():
    found = worst_gain(model_of(stiffness=(0.0, 8.0)), [0.0, 5.0])
    assert found.bound[0] == np.inf
    assert found.bound[1] < 1.0


def test_light_damping_is_not_lost_beside_stiffness():
    """Its share of what the parameters change is a thousandth, and it alone decides the gain."""
    model = model_of(stiffness=(3.999, 4.001), damping=(2e-4, 3.8e-3))
    found = worst_gain(model, 2.0, tolerance=TOLERANCE, boxes=20_000)
    exact = 1.0 / (2.0 * 2e-4)
    assert exact < found.bound[0] < exact * (1.0 + 2.0 * TOLERANCE)


class Pair(Block):
    """Two inputs, three outputs, an array of gains."""

    u = Input(2)
    y = Output(3)
    x = State(2)
    gains = Parameter([1.0, 2.0], shape=(2,))

    def output(self, t, x, u, p):
        return {"y": np.stack([x.x[0], x.x[1], x.x[0] + x.x[1]])}

    def derivative(self, t, x, u, p):
        return {"x": p.gains * u.u - x.x}


def test_several_inputs_outputs_and_elements():
    model = uncertain(Pair(), "u", "y", {"Pair.gains": ([1.5, 2.5], [0.5, 1.0])})
    assert model.values([1.0])["Pair.gains"] == pytest.approx([1.5, 2.5], rel=1e-12)
    found = worst_gain(model, 0.0, tolerance=TOLERANCE)
    exact = np.linalg.norm(np.array([[1.5, 0.0], [0.0, 2.5], [1.5, 2.5]]), 2)
    assert found.reached[0] == pytest.approx(exact, rel=1e-6)
    assert exact < found.bound[0] < exact * (1.0 + 2.0 * TOLERANCE)


def test_no_gain_at_all_is_bounded_by_none():
    model = uncertain(Pair(), "u[0]", "y[1]", {"Pair.gains": ([0.5, 1.0], [1.5, 2.5])})
    assert worst_gain(model, 1.0).bound[0] == 0.0


def test_bounds_of_another_model_than_the_diagram_are_warned_of():
    """Here a parameter jumps within the range of what is uncertain."""
    model = uncertain(Oscillator(), "force", "position", {"s": (-1.0, 1.0)}, becoming=flipping)
    assert model.misfit > 0.1
    with pytest.warns(SimulationWarning, match=r"at 1\.9 rad/s the diagram itself has a gain of"):
        worst_gain(model, [1.9])


def flipping(s):
    return {"Oscillator.stiffness": 4.0 + np.sign(s + 0.3)}


def test_sampled_diagrams_are_uncertain_too():
    diagram = Diagram("loop")
    hold, plant = diagram.add(hold=ZeroOrderHold(0.1), plant=Oscillator())
    hold.y >> plant.force
    diagram.expose(u=hold.u, y=plant.position)
    model = uncertain(diagram, "u", "y", {"plant.stiffness": 0.2})
    assert model.nominal.dt == pytest.approx(0.1, rel=1e-12)
    found = worst_gain(model, [0.0, 1.9], tolerance=TOLERANCE)
    assert found.reached[0] == pytest.approx(1.0 / 3.2, rel=model.misfit + 1e-3)
    exact = [abs(model.family(np.array([d]))(np.exp(0.19j), squeeze=True)) for d in np.linspace(-1, 1, 41)]
    assert max(exact) < found.bound[1]
    assert max(exact) > found.bound[1] / 1.2


def test_bounds_of_the_structured_singular_value():
    random = np.random.default_rng(3)
    matrix = random.standard_normal((4, 4)) + 1j * random.standard_normal((4, 4))
    assert mu_bound(matrix, 0, 4) == pytest.approx(np.linalg.norm(matrix, 2), rel=1e-6)
    assert mu_bound(1e9 * matrix, 0, 4) == pytest.approx(1e9 * np.linalg.norm(matrix, 2), rel=1e-6)
    assert mu_bound(matrix, 2, 2) < np.linalg.norm(matrix, 2) * (1.0 + 1e-6)
    assert mu_bound(np.array([[2j]]), 1, 0) == 0.0  # no real number makes 1 - 2j δ singular


BLOCKS = slice(0, 2), slice(2, 3), slice(3, 5)


@pytest.mark.parametrize("seed", range(5))
def test_no_member_exceeds_what_the_series_gives(seed):
    random = np.random.default_rng(seed)
    box = random.standard_normal((7, 6)) + 1j * random.standard_normal((7, 6))
    box[:5] *= 0.1
    bound = GainSeries(box, BLOCKS).bound
    members = [gain_in(box, delta) for delta in [*corners(3), *random.uniform(-1.0, 1.0, (500, 3))]]
    assert max(members) < bound < 1.5 * max(members)


def test_the_bound_of_small_boxes_is_sharp():
    """What the bound adds to the greatest gain falls with the square of the box: the first order is exact."""
    random = np.random.default_rng(1)
    box = random.standard_normal((7, 6)) + 1j * random.standard_normal((7, 6))
    excess = []
    for width in (1e-2, 1e-3):
        small = np.vstack([box[:5], box[5:] / width])
        small[:, :5] *= width
        small[5:, 5:] += np.eye(2, 1)
        greatest = max(gain_in(small, delta) for delta in corners(3))
        excess.append(GainSeries(small, BLOCKS).bound - greatest)
    assert 0.0 <= excess[1] < excess[0] / 9.0


def test_a_box_that_may_hold_a_pole_has_no_bound():
    box = np.array([[1.1, 1.0], [1.0, 0.0]])
    assert GainSeries(box, [slice(0, 1)]).bound == np.inf


def gain_in(box, delta):
    """Return the gain of one member of a box with `BLOCKS`."""
    each = np.diag(np.repeat(delta, [2, 1, 2]))
    inner = each @ np.linalg.solve(np.eye(5) - box[:5, :5] @ each, box[:5, 5:])
    return float(np.linalg.norm(box[5:, 5:] + box[5:, :5] @ inner, 2))


TRUSS_RANGES = {
    "mass": (0.95, 1.05),
    "frequency": (0.95, 1.05),
    "damping": (0.01, 0.03),
    "payload": (0.0, 10.0),
}


def aligned(truss, like):
    """Return the truss with shapes of the sign that another one's have: a mode may have either."""
    sign = np.sign(np.einsum("pim,pim->m", truss.shapes, like.shapes))
    moving = ("shapes", "grasp_translations", "grasp_rotations")
    return replace(truss, **{name: sign * getattr(truss, name) for name in moving})


@pytest.mark.slow
def test_a_truss_with_uncertain_mass_frequency_damping_and_payload():
    plant = TunableTruss.consistent(modes=3)
    modes: TrussModes = plant.dynamics.modes
    tip = modes.positions[np.argmax(np.linalg.norm(modes.positions, axis=1))]

    def becoming(mass, frequency, damping, payload):
        bare = scaled(modes.damped(0.0), mass=mass, frequency=frequency)
        truss = aligned(loaded(bare, tip, payload).damped(damping), modes)
        return {f"truss.{name}": value for name, value in plant.truss_parameters(truss).items()}

    diagram = Diagram("truss")
    diagram.add(truss=plant)
    diagram.ground(plant.actuation)
    ports = "truss.actuation[2]", "truss.grasp_displacement[3,2]"
    model = uncertain(diagram, *ports, TRUSS_RANGES, becoming=becoming)
    assert model.misfit < 0.01
    first = np.min(np.abs(model.nominal.poles())[np.abs(model.nominal.poles()) > 1.0])
    omega = np.array([0.8, 0.95, 1.0, 1.05, 1.2]) * first
    found = worst_gain(model, omega, tolerance=0.1, boxes=20_000)
    sampled = gains(model, omega, 200)
    assert np.all(sampled < found.bound)
    ours = [
        abs(model.family(delta_of(model, k))(1j * w, squeeze=True))
        for k, w in zip(found.parameters, omega, strict=True)
    ]
    assert np.all(np.array(ours) > found.bound / 1.2)


def delta_of(model, values):
    """Return the numbers from -1 to 1 that stand for values."""
    return np.array(
        [(2.0 * values[name] - low - high) / (high - low) for name, (low, high) in model.ranges.items()]
    )


BAD: dict[str, dict[str, Any]] = {
    "nothing is uncertain": {},
    "there is no parameter 'Oscillator.friction'": {"Oscillator.friction": 0.1},
    "give (least, greatest)": {"Oscillator.mass": [1.0, 2.0, 3.0]},
    "have different shapes": {"Oscillator.mass": (1.0, [2.0, 3.0])},
    "leaves no room": {"Oscillator.mass": 0.0},
    "'Oscillator.colour' changes nothing": {"Oscillator.mass": 0.1, "Oscillator.colour": 0.1},
}


@pytest.mark.parametrize("message", BAD)
def test_what_cannot_be_uncertain(message):
    with pytest.raises(LinearAnalysisError, match=re.escape(message)):
        uncertain(Oscillator(), "force", "position", BAD[message])


def test_what_has_no_greatest_gain():
    with pytest.raises(LinearAnalysisError, match="none below 0"):
        worst_gain(model_of(mass=0.1), -1.0)
    with pytest.raises(LinearAnalysisError, match="none below 0"):
        worst_gain(model_of(mass=0.1), [])
    with pytest.raises(LinearAnalysisError, match="the model is unstable"):
        worst_gain(model_of(stiffness=(-5.0, -3.0)), 1.0)
    with pytest.raises(LinearAnalysisError, match="the model is unstable"):  # at a corner alone
        worst_gain(model_of(damping=(-0.1, 0.3)), 1.0)
    with pytest.raises(ParameterError, match="numbers from -1 to 1"):
        model_of(mass=0.1).values([0.0, 0.0])
