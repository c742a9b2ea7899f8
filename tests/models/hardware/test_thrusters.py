"""Thrusters make the demanded wrench by thrusts that are never negative; no impulse is lost."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy.optimize import linprog
from systems import assert_near, simulate_block

from trussflow.blocks import Constant, Noise, Step
from trussflow.models import ModelError, Pulses, ThrusterSet
from trussflow.models.hardware.thrusters import wrench_matrix

LAW = {"maximum": 1.0, "period": 0.1, "specific_impulse": 70.0}
ROUND_OFF = 1e-9
wrenches = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array)
seeds = st.integers(0, 2**32 - 1)


def scattered(**settings):
    """Return sixteen thrusters anywhere, none opposed to another, of which all wrenches can be made."""
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((16, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return ThrusterSet(rng.uniform(-1.0, 1.0, (16, 3)), directions, **settings)


SETS = {
    "pairs": lambda: ThrusterSet.pairs(0.4, quantum=0.1, **LAW),
    "scattered": lambda: scattered(quantum=0.1, **LAW),
}


def fire(thrusters, demand, duration, step=0.1, **sources):
    """Simulate thrusters with a demand, logged once a period or tick."""
    log = {
        name: thrusters.port(name) for name in ("thrust", "wrench", "propellant")
    } | {"demand": demand.y}
    return simulate_block(
        thrusters, duration, {"demand": demand, **sources}, step=step, log=log
    )


def missing_impulse(result, step=0.1):
    """Return, at each time, the impulse wanted less the impulse given."""
    return step * np.cumsum((result["demand"] - result["wrench"]).values[:-1], axis=0)


@given(seed=seeds)
def test_any_layout_is_exact_or_an_error(seed):
    """Few or many, near or far, opposed or not: an error where a linear programme has no solution."""
    rng = np.random.default_rng(seed)
    count, torques = rng.integers(3, 20), bool(rng.integers(2))
    directions = rng.standard_normal((count, 3))
    positions = 10.0 ** rng.uniform(-1.0, 1.0) * rng.uniform(-1.0, 1.0, (count, 3))
    if rng.integers(2):
        directions, positions = (
            np.concatenate([directions, -directions]),
            np.tile(positions, (2, 1)),
        )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    matrix, parts = wrench_matrix(positions, directions), 6 if torques else 3
    units = [sign * np.eye(6)[k] for k in range(parts) for sign in (1, -1)]
    possible = all(
        linprog(np.ones(matrix.shape[1]), A_eq=matrix, b_eq=unit).success
        for unit in units
    )
    try:
        thrusters = ThrusterSet(
            positions, directions, quantum=0.1, torques=torques, **LAW
        )
    except ModelError:
        assert not possible
        return
    assert possible
    for wrench in rng.standard_normal((20, 6)) * (np.arange(6) < parts):
        thrusts = thrusters.thrusts(wrench)
        assert thrusts.min() >= -ROUND_OFF
        assert_near(matrix @ thrusts, wrench, 1e-8)


@given(seed=seeds)
def test_thrusters_at_one_place_share_its_work(seed):
    """Some thrusters twice or more: all wrenches are exact."""
    rng = np.random.default_rng(seed)
    once = ThrusterSet.pairs(0.4, quantum=0.1, **LAW).matrix
    columns = np.column_stack([once, once[:, rng.integers(0, 12, rng.integers(1, 6))]])
    ways, places = columns[:3].T, np.cross(columns[:3].T, columns[3:].T)
    thrusters = ThrusterSet(places, ways, quantum=0.1, **LAW)
    for wrench in rng.standard_normal((20, 6)):
        assert_near(thrusters.matrix @ thrusters.thrusts(wrench), wrench, ROUND_OFF)


@given(wrench=wrenches)
def test_opposed_pairs_waste_no_propellant(wrench):
    """The linear programme that minimizes the sum of thrusts finds nothing better."""
    thrusters = SETS["pairs"]()
    # linprog takes numbers below 1e-7 as zero.
    best = linprog(np.ones(12), A_eq=thrusters.matrix, b_eq=1e3 * wrench)
    assert thrusters.thrusts(wrench).sum() == pytest.approx(
        best.fun / 1e3, rel=1e-9, abs=1e-9
    )


def test_axial_thrusters_make_forces_and_leave_torques_alone():
    thrusters = ThrusterSet.axial(quantum=0.1, **LAW)
    thrusts = thrusters.thrusts(np.array([0.5, -0.7, 0.0, 9.0, -9.0, 9.0]))
    assert_near(thrusts, [0.5, 0, 0, 0, 0.7, 0], ROUND_OFF)


@pytest.mark.parametrize("kind", SETS)
@pytest.mark.parametrize("minimum_impulse", [0.0, 0.03])
def test_sigma_delta_loses_no_impulse(kind, minimum_impulse):
    """At no time is more missing than one period's rounding, or than minimum impulses, can be."""
    law = LAW | {"quantum": 0.1, "minimum_impulse": minimum_impulse, "maximum": 50.0}
    thrusters = ThrusterSet.pairs(0.4, **law) if kind == "pairs" else scattered(**law)
    result = fire(thrusters, Noise(np.full(6, 0.3), 0.1, seed=2, mean=0.02), 200.0)
    left_over = (
        max(0.05, minimum_impulse / 0.1) * 0.1 * np.abs(thrusters.matrix).sum(axis=1)
    )
    assert (np.abs(missing_impulse(result)).max(axis=0) <= left_over + ROUND_OFF).all()
    thrust = result["thrust"].values
    assert thrust.min() >= 0.0
    assert thrust[thrust > 0].min() >= minimum_impulse / 0.1 - ROUND_OFF
    assert_near(thrust / 0.1, np.rint(thrust / 0.1), 1e-6)


def test_limits_are_never_exceeded_and_lose_what_is_beyond():
    # no multiple of the quantum is the limit
    thrusters = ThrusterSet.pairs(0.4, quantum=0.35, **LAW)
    result = fire(thrusters, Noise(np.full(6, 2.0), 0.1, seed=2), 50.0)
    assert result["thrust"].max() <= 1.0
    thrusters = ThrusterSet.axial(quantum=0.1, **LAW)
    result = fire(
        thrusters,
        Step(
            1.0, initial_value=[5.0, 0, 0, 0, 0, 0], final_value=[0.25, 0, 0, 0, 0, 0]
        ),
        9.0,
    )
    mean = result["wrench"].values[10:-1, 0].mean()
    assert mean == pytest.approx(0.25, abs=0.1 / 80)  # nothing wound up


def test_effectiveness_scales_thrust_and_kills():
    health = Step(1.0, initial_value=0.5, final_value=0.0)
    result = fire(
        ThrusterSet.axial(quantum=0.1, **LAW),
        Constant([0, 0.4, 0, 0, 0, 0]),
        2.0,
        effectiveness=health,
    )
    assert_near(result["wrench"][1:10, 1], 0.2, ROUND_OFF)
    assert abs(result["wrench"][10:]).max() == 0.0
    # Counted from the orders: 0.4 N for 2 s.
    assert result["propellant"][-1] == pytest.approx(
        2.0 * 0.4 / (70.0 * 9.80665), rel=1e-9
    )


def test_pulses_have_the_average_that_is_wanted():
    """On-times are whole ticks; carried on, the average over many periods is the demand's."""
    thrusters = ThrusterSet.axial(tick=0.01, **LAW)
    demand = np.array([0.123, -0.456, 0.789, 0, 0, 0])
    result = fire(thrusters, Constant(demand), 100.0, step=0.01)
    thrust, wrench = result["thrust"].values[:-1], result["wrench"].values[:-1]
    assert set(np.unique(thrust)) == {0.0, 1.0}
    assert_near(wrench.mean(axis=0)[:3], demand[:3], 0.05 * 0.1 / 100.0 + 1e-12)
    period = thrust.reshape(-1, 10, 6)
    assert (
        np.diff(period, axis=1) <= 0
    ).all()  # one pulse, from the start of the period


def test_pulses_are_no_shorter_than_the_minimum_impulse():
    thrusters = ThrusterSet.axial(tick=0.01, minimum_impulse=0.04, **LAW)
    result = fire(thrusters, Constant([0.07, 0, 0, 0, 0, 0]), 100.0, step=0.01)
    impulses = result["thrust"].values[:-1, 0].reshape(-1, 10).sum(axis=1) * 0.01
    assert set(impulses.round(9)) == {0.0, 0.04}
    assert abs(impulses.sum() - 7.0) <= 0.04


@pytest.mark.parametrize("count", [10, 20, 33])
def test_every_pulse_width_comes_out(count):
    """Round-off in a thrust of k quanta does not cost a tick."""
    thrusts = np.arange(count + 1) * (0.7 / count)
    pulses = Pulses(count + 1, 0.7, count * 0.01, 0.01)
    settings = {"step": 0.01, "backend": "numpy"}
    y = simulate_block(pulses, count * 0.01, {"thrust": Constant(thrusts)}, **settings)[
        "block.y"
    ].values
    assert_array_equal((y[:-1] > 0).sum(axis=0), np.arange(count + 1))


@pytest.mark.parametrize(
    "opens, closes", [(0.0, 0.0), (0.02, 0.02), (0.02, 0.05), (0.03, 0.01), (0.0, 0.12)]
)
def test_valves_take_time(opens, closes):
    """A pulse of 60 ms every 100 ms opens and closes late, each by its own delay."""
    pulses = Pulses(2, 1.0, 0.1, 0.01, on_delay=opens, off_delay=closes)
    y = simulate_block(pulses, 1.0, {"thrust": Constant([0.6, 0.0])}, step=0.01)[
        "block.y"
    ].values
    ticks = np.arange(101)
    starts = [10 * k + round(opens * 100) for k in range(10)]
    expected = [
        any(0 <= n - s < 6 + round((closes - opens) * 100) for s in starts)
        for n in ticks
    ]
    assert_array_equal(y[:-1, 0], expected[:-1])
    assert y[:, 1].max() == 0.0


ONE_SIDED = (np.zeros((3, 3)), np.eye(3))
LAYOUT_ERRORS = [
    (
        lambda: ThrusterSet(*ONE_SIDED, quantum=0.1, torques=False, **LAW),
        "make no negative force along x alone",
    ),
    (
        lambda: ThrusterSet(
            np.zeros((6, 3)), [*np.eye(3), *-np.eye(3)], quantum=0.1, **LAW
        ),
        "make no positive torque about x alone",
    ),
    (
        lambda: ThrusterSet(
            np.zeros((2, 3)), [[1, 0, 0], [2, 0, 0]], quantum=0.1, **LAW
        ),
        "direction 1 has length 2",
    ),
    (
        lambda: ThrusterSet(np.zeros((0, 3)), np.zeros((0, 3)), quantum=0.1, **LAW),
        "thrusters: direction: there are none",
    ),
    (
        lambda: ThrusterSet.pairs(0.0, quantum=0.1, **LAW),
        "lever is 0; it must be above 0",
    ),
    (
        lambda: wrench_matrix(np.zeros((2, 3)), np.eye(3)),
        r"positions has shape \(2, 3\); it must be \(3, 3\)",
    ),
]


@pytest.mark.parametrize("build, message", LAYOUT_ERRORS)
def test_errors_of_layouts(build, message):
    with pytest.raises(ModelError, match=message):
        build()


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"quantum": 0.1, "maximum": -1.0}, "maximum is -1; it must be above 0"),
        ({"quantum": 2.0}, "quantum is 2 N; it must be at most maximum, 1 N"),
        ({"quantum": 0.0}, "quantum is 0; it must be above 0"),
        (
            {"quantum": 0.1, "minimum_impulse": -1.0},
            "minimum_impulse is -1; it must be at",
        ),
        ({}, "a quantum .throttled., or a tick"),
        ({"quantum": 0.1, "tick": 0.01}, "a quantum .throttled., or a tick"),
        ({"quantum": 0.1, "on_delay": 0.1}, "a tick .pulsed, with delays."),
        (
            {"tick": 0.03},
            "period is 0.1 s; it must be a whole number of ticks of 0.03 s",
        ),
        (
            {"tick": 0.01, "on_delay": 0.005},
            "on_delay is 0.005 s; it must be a whole number",
        ),
    ],
)
def test_errors_of_settings(settings, message):
    with pytest.raises(ModelError, match=message):
        ThrusterSet.axial(**LAW | settings)
