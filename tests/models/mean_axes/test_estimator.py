"""The estimator of the mean axes: what it believes is what happens, arms and all."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Constant, Diagram, Session, simulate
from trussflow.models import MeanAxesDesign, MeanAxesEstimator, SpaceTruss


def pushed(sample_time):
    """Return where a rigid truss is that is pushed at random for 0.4 s, and what is predicted of it."""
    flexible = SpaceTruss.consistent().dynamics
    truss = SpaceTruss(flexible.without_modes())
    estimator = MeanAxesEstimator(
        flexible, replace(MeanAxesDesign.shipped(), sample_time=sample_time)
    )
    commands = 0.002 * np.random.default_rng(3).standard_normal(truss.actuators)
    diagram = Diagram("pushed")
    push = diagram.add(push=Constant(commands, unit=truss.actuator_units))
    diagram.add(truss=truss, estimator=estimator)
    push.y >> truss.actuation
    push.y >> estimator.actuation
    truss.task_position >> estimator.position
    truss.rigid_speeds >> estimator.velocity
    result = simulate(
        diagram,
        0.4,
        step=0.01,
        log=[truss.task_position, estimator.mean_position],
        log_step=0.4,
        parameters={"estimator.gain": np.zeros_like(estimator.parameters["gain"])},
    )
    return result["truss.task_position"][-1].values, result["estimator.mean_position"][
        -1
    ].values


def test_prediction_is_of_first_order():
    """Without correction, a rigid truss goes where the estimator says."""
    errors = []
    for sample_time in (0.04, 0.02):
        position, predicted = pushed(sample_time)
        assert (
            np.abs(position - SpaceTruss.consistent().dynamics.rest[:34]).max() > 0.05
        )
        errors.append(np.abs(position - predicted).max())
    assert errors[0] < 1e-2
    assert 0.8 < np.log2(errors[0] / errors[1]) < 1.2


ORDINARY = {"MeanAxesEstimator.sudden_innovation": 1e9}
"""Parameter without the change of the gain."""


def disturbances(acceleration, noise, parameters=None, coordinate=2):
    """Return the estimated disturbance and the true acceleration after 1.5 s, constant along one coordinate."""
    dynamics, design = SpaceTruss.consistent().dynamics, MeanAxesDesign.shipped()
    rng, rest = np.random.default_rng(1), dynamics.rest[: dynamics.rigid_coordinates]
    along = np.eye(len(rest))[coordinate]
    session = Session(MeanAxesEstimator(dynamics, design), step=design.sample_time)
    with session:
        session.start(inputs={"position": rest}, parameters=parameters)
        for time in design.sample_time * np.arange(1, 76):
            session.advance(time)
            session.set(
                position=rest
                + 0.5 * acceleration * time**2 * along
                + noise * rng.standard_normal(len(rest)),
                velocity=acceleration * time * along
                + noise * rng.standard_normal(len(rest)),
            )
        return session.outputs["disturbance"], acceleration * along


def test_a_sudden_disturbance_is_estimated_fast():
    """Within 1.5 s; without the change of the gain it takes much longer."""
    rigid = SpaceTruss.consistent().dynamics.without_modes()
    mass = rigid.evaluate(rigid.rest).mass_matrix[2, 2]
    errors = []
    for parameters in (None, ORDINARY):
        found, wanted = disturbances(0.02, 0.0, parameters)
        errors.append(abs(found[2] / (mass * wanted[2]) - 1.0))
    assert errors[0] < 0.15
    assert errors[1] > 0.7


@pytest.mark.parametrize(
    "acceleration, noise, coordinate, sudden",
    [(0.0, 1e-4, 2, False), (0.02, 0.0, 4, True), (0.02, 0.0, 6, False)],
)
def test_only_the_truss_shows_a_sudden_disturbance(
    acceleration, noise, coordinate, sudden
):
    """Its rates do; noise and motion of joints do not."""
    found, ordinary = (
        disturbances(acceleration, noise, parameters, coordinate)[0]
        for parameters in (None, ORDINARY)
    )
    assert np.array_equal(found, ordinary) != sudden
