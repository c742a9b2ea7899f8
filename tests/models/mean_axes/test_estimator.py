"""The estimator of the mean axes: what it believes is what happens, arms and all."""

from dataclasses import replace

import numpy as np

from trussflow.blocks import Constant, Diagram, simulate
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
