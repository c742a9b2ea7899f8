"""Uncertain models against exact members: nothing beyond the bounds, and the bounds are reached."""

from itertools import product

import numpy as np
import pytest
from systems import Oscillator, series

from trussflow.blocks import Gain, StateSpace, ZeroOrderHold
from trussflow.blocks.errors import (
    LinearAnalysisError,
    ParameterError,
    SimulationWarning,
)
from trussflow.blocks.linear_analysis.uncertainty import uncertain, worst_gain
from trussflow.blocks.linear_analysis.uncertainty.gain_series import GainSeries, corners

TOLERANCE = 0.05


def model_of(**ranges):
    given = {f"Oscillator.{name}": value for name, value in ranges.items()}
    return uncertain(Oscillator(), "u", "y[0]", given)


def gains(model, omega, count):
    """Return the greatest gain at each frequency among exact members, those at all corners included."""
    drawn = np.random.default_rng(7).uniform(-1.0, 1.0, (count, len(model.ranges)))
    deltas = np.vstack([drawn, list(product((-1.0, 1.0), repeat=len(model.ranges)))])
    responses = [
        np.abs(model.family(delta)(1j * omega, squeeze=True)) for delta in deltas
    ]
    return np.max(responses, axis=0)


def test_what_is_linear_or_quadratic_in_the_parameters_is_exact():
    model = model_of(stiffness=0.2, damping=(0.05, 0.3))
    assert model.fractions.sizes == (1, 1)
    assert model.misfit < 1e-12
    exact = model.family(np.array([0.3, -0.7]))
    f = model.fractions.at(np.array([0.3, -0.7]))
    assert f[:2, :2] == pytest.approx(exact.A, abs=1e-12)
    assert model.values([0.3, -0.7])["Oscillator.stiffness"] == pytest.approx(
        4.0 * 1.06, rel=1e-12
    )


def test_a_spring_is_softest_where_its_stiffness_is_least():
    found = worst_gain(model_of(stiffness=0.2, damping=0.5), 0.0, tolerance=TOLERANCE)
    assert found.reached[0] == pytest.approx(1.0 / 3.2, rel=1e-6)
    assert (
        found.reached[0]
        <= found.bound[0]
        <= found.reached[0] * (1.0 + TOLERANCE) * (1.0 + 1e-9)
    )
    assert found.parameters[0]["Oscillator.stiffness"] == pytest.approx(3.2, rel=1e-6)


def test_no_member_is_beyond_the_bound_and_one_is_near():
    model = model_of(stiffness=0.1, damping=0.5, mass=0.05)
    assert model.misfit < 0.01
    omega = np.array([0.5, 1.8, 2.2])
    found, sampled = (
        worst_gain(model, omega, tolerance=TOLERANCE, boxes=4000),
        gains(model, omega, 500),
    )
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


def pair(inputs, outputs):
    """Return an uncertain model with two inputs, three outputs and an array of gains."""
    diagram = series(
        gains=Gain([1.0, 2.0]),
        lags=StateSpace(-np.eye(2), np.eye(2), [[1, 0], [0, 1], [1, 1]]),
    )
    diagram.expose(u=diagram.gains.u, y=diagram.lags.y)
    return uncertain(diagram, inputs, outputs, {"gains.gain": ([1.5, 2.5], [0.5, 1.0])})


def test_several_inputs_outputs_and_elements():
    model = pair("u", "y")
    assert model.values([1.0])["gains.gain"] == pytest.approx([1.5, 2.5], rel=1e-12)
    found = worst_gain(model, 0.0, tolerance=TOLERANCE)
    exact = np.linalg.norm(np.array([[1.5, 0.0], [0.0, 2.5], [1.5, 2.5]]), 2)
    assert found.reached[0] == pytest.approx(exact, rel=1e-6)
    assert exact < found.bound[0] < exact * (1.0 + 2.0 * TOLERANCE)


def test_no_gain_at_all_is_bounded_by_none():
    assert worst_gain(pair("u[0]", "y[1]"), 1.0).bound[0] == 0.0


def test_bounds_of_another_model_than_the_diagram_are_warned_of():
    """Here a parameter jumps within the range of what is uncertain."""

    def flipping(s):
        return {"Oscillator.stiffness": 4.0 + np.sign(s + 0.3)}

    model = uncertain(Oscillator(), "u", "y[0]", {"s": (-1.0, 1.0)}, becoming=flipping)
    assert model.misfit > 0.1
    with pytest.warns(
        SimulationWarning, match=r"at 1\.9 rad/s the diagram itself has a gain of"
    ):
        worst_gain(model, [1.9])


def test_sampled_diagrams_are_uncertain_too():
    diagram = series(hold=ZeroOrderHold(0.1), plant=Oscillator())
    diagram.expose(u=diagram.hold.u, y=diagram.plant.y)
    model = uncertain(diagram, "u", "y[0]", {"plant.stiffness": 0.2})
    assert model.nominal.dt == pytest.approx(0.1, rel=1e-12)
    found = worst_gain(model, [0.0, 1.9], tolerance=TOLERANCE)
    assert found.reached[0] == pytest.approx(1.0 / 3.2, rel=model.misfit + 1e-3)
    exact = [
        abs(model.family(np.array([d]))(np.exp(0.19j))) for d in np.linspace(-1, 1, 41)
    ]
    assert found.bound[1] / 1.2 < max(exact) < found.bound[1]


BLOCKS = slice(0, 2), slice(2, 3), slice(3, 5)


def box_of(seed):
    """Return a random box with `BLOCKS`, and the generator."""
    random = np.random.default_rng(seed)
    return random.standard_normal((7, 6)) + 1j * random.standard_normal((7, 6)), random


def gain_in(box, delta):
    """Return the gain of one member of a box with `BLOCKS`."""
    each = np.diag(np.repeat(delta, [2, 1, 2]))
    inner = each @ np.linalg.solve(np.eye(5) - box[:5, :5] @ each, box[:5, 5:])
    return np.linalg.norm(box[5:, 5:] + box[5:, :5] @ inner, 2)


@pytest.mark.parametrize("seed", range(5))
def test_no_member_exceeds_the_bound_of_the_series(seed):
    box, random = box_of(seed)
    box[:5] *= 0.1
    bound = GainSeries(box, BLOCKS).bound
    greatest = max(
        gain_in(box, delta)
        for delta in [*corners(3), *random.uniform(-1.0, 1.0, (500, 3))]
    )
    assert greatest < bound < 1.5 * greatest


@pytest.mark.parametrize(
    "ranges, message",
    [
        ({}, "nothing is uncertain"),
        ({"friction": 0.1}, "there is no parameter 'Oscillator.friction'"),
        ({"mass": [1.0, 2.0, 3.0]}, r"give \(least, greatest\)"),
        ({"mass": (1.0, [2.0, 3.0])}, "have different shapes"),
        ({"mass": 0.0}, "leaves no room"),
        ({"mass": 0.1, "start": 0.1}, "'Oscillator.start' changes nothing"),
    ],
)
def test_bad_ranges_are_refused(ranges, message):
    with pytest.raises(LinearAnalysisError, match=message):
        model_of(**ranges)


@pytest.mark.parametrize(
    "ranges, omega, message",
    [
        ({"mass": 0.1}, -1.0, "none below 0"),
        ({"mass": 0.1}, [], "none below 0"),
        ({"stiffness": (-5.0, -3.0)}, 1.0, "the model is unstable"),
        ({"stiffness": (-1.0, 9.0)}, 1.0, "the model is unstable"),  # at a corner alone
    ],
)
def test_models_without_a_greatest_gain_are_refused(ranges, omega, message):
    with pytest.raises(LinearAnalysisError, match=message):
        worst_gain(model_of(**ranges), omega)


def test_deltas_beyond_one_are_refused():
    with pytest.raises(ParameterError, match="numbers from -1 to 1"):
        model_of(mass=0.1).values([0.0, 0.0])


def test_the_bound_of_small_boxes_is_sharp():
    """The excess over the greatest gain falls with the square of the box: the first order is exact."""
    box, _ = box_of(1)
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


def test_the_bound_of_positive_numbers_is_their_gain():
    """All terms are greatest where both parameters are: nothing is added, nothing left out."""
    box = np.array([[0.3, 0.5, 1.0], [0.1, 0.2, 2.0], [3.0, 4.0, 5.0]])
    greatest = 5.0 + box[2, :2] @ np.linalg.solve(np.eye(2) - box[:2, :2], box[:2, 2])
    bound = GainSeries(box, [slice(0, 1), slice(1, 2)]).bound
    assert bound == pytest.approx(greatest, rel=1e-12)
