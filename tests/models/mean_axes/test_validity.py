"""Invalid measurements and commands: coasting, gates, bounds, and the last finite command."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from trussflow.blocks.framework.declarations import Signals
from trussflow.models import (
    CommandHold,
    MeanAxesDesign,
    MeanAxesEstimator,
    MeasurementGate,
    SpaceTruss,
)

DESIGN = MeanAxesDesign.shipped()
DYNAMICS = SpaceTruss.consistent().dynamics
RIGID = DYNAMICS.rigid_coordinates
REST, STEP = DYNAMICS.rest[:RIGID], DESIGN.sample_time


GATE, ESTIMATOR = (
    MeasurementGate(DYNAMICS, DESIGN),
    MeanAxesEstimator(DYNAMICS, DESIGN),
)


def measured(samples):
    """Return states and outages after each measurement of position, velocity and validity.

    A `Session` accepts finite inputs only, so gate and estimator are evaluated here.
    """
    p = Signals("p", ESTIMATOR.parameters)
    names = ESTIMATOR.states()
    x = Signals("x", {name: np.zeros(ESTIMATOR.state_shape(name)) for name in names})
    x["y"], x["posture"] = p.initial_position, p.initial_posture
    coasting, now, shown = Signals("x", {"coasting": np.array(0.0)}), np.array(0.0), []
    for position, velocity, valid in samples:
        u = {"position": position, "velocity": velocity, "valid": np.array(valid)}
        u = Signals("u", u | {"mean_position": x.y, "mean_speeds": x.nu})
        seen = GATE.output(now, coasting, u, Signals("p", GATE.parameters))
        coasting["coasting"] = seen["outage"]
        u = {name: seen[f"checked_{name}"] for name in ("position", "velocity")}
        u = Signals("u", u | {"actuation": np.zeros(DYNAMICS.actuators)})
        x = Signals("x", ESTIMATOR.update(now, x, u, p))
        shown.append({"seen": x.y, "speeds": x.nu, "disturbance": x.w} | seen)
    return shown


def drifting(k, valid=1.0):
    """Return the measurement of a truss that moves along z, too slowly for a sudden disturbance."""
    rates = 1e-3 * np.eye(RIGID)[2]
    return REST + k * STEP * rates, rates, valid


@pytest.mark.parametrize("frozen", [(0.0, 0.0), (np.nan, 1.0), (1.0, 1.0)])
def test_without_a_pose_the_truss_coasts(frozen):
    """For 1 s the pose is marked as invalid, is not finite, or jumps by 1 m: the prediction goes on."""
    offset, valid = frozen
    pose = np.where(np.arange(RIGID) < 6, offset, 0.0)
    lost = (pose + REST, np.zeros(RIGID), valid)
    found = measured([drifting(k) for k in range(100)] + [lost] * 50)
    speed = found[99]["speeds"][2]
    assert speed == pytest.approx(1e-3, rel=0.05)
    way = found[149]["seen"][2] - found[99]["seen"][2]
    assert way == pytest.approx(50 * STEP * speed, abs=1e-4)
    assert found[99]["outage"] == 0.0
    assert found[149]["outage"] == pytest.approx(50 * STEP)


def test_after_a_long_outage_a_far_pose_is_accepted():
    far = (REST + 0.05 * np.eye(RIGID)[0], np.zeros(RIGID), 1.0)
    found = measured([far] * 120)
    assert np.abs(found[40]["seen"]).max() < 1e-6
    assert found[-1]["seen"][0] > 1e-3
    near = measured([far] * 55 + [(REST, np.zeros(RIGID), 1.0)])
    assert near[-2]["outage"] > 1.0
    assert near[-1]["outage"] == 0.0


def test_no_measurement_makes_an_estimate_diverge(rng):
    samples = []
    for size in 10.0 ** rng.uniform(-4, 12, 100):
        position, velocity = size * rng.standard_normal((2, RIGID))
        position[rng.integers(RIGID)] = rng.choice([np.nan, np.inf, 0.0])
        samples.append((position, velocity, float(rng.random() < 0.8)))
    for out in measured(samples):
        assert np.abs(out["speeds"]).max() <= 10.0
        assert np.abs(out["disturbance"]).max() <= 100.0
        assert np.isfinite(out["seen"]).all()


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf, -1e9])
def test_the_last_finite_command_is_held(rng, bad):
    hold = CommandHold(DYNAMICS, DESIGN)
    wanted, last = rng.standard_normal((2, DYNAMICS.actuators))
    wanted[3] = bad
    x, u = Signals("x", {"last": last}), Signals("u", {"request": wanted})
    found = hold.output(np.array(0.0), x, u, Signals("p", hold.parameters))
    assert_array_equal(found["command"], last if bad else wanted)
    assert found["command_valid"] == (bad == 0.0)
