"""The plant block: conservation and convergence in time, actuators, and units."""

import numpy as np
import pytest
from systems import assert_near

from trussflow.blocks.framework.declarations import Signals
from trussflow.models import ModelError, SpaceTruss


def test_runs_converge_at_fourth_order(random_system, free_motion):
    """RK4 against its own result at an eighth of the smallest step; drifts fall as fast or faster."""
    system = random_system(("RR", "P"), 2, elastic_integrals=True)
    q, v = 0.3 * np.random.default_rng(3).standard_normal((2, system.coordinates))
    motions = [
        free_motion(
            SpaceTruss(system), 2.0, system.rest + q, v, step=step, log_step=2.0
        )
        for step in (0.1, 0.05, 0.025, 0.025 / 8)
    ]
    *ends, reference = [
        np.concatenate([motion.q[-1], motion.v[-1]]) for motion in motions
    ]
    errors = [np.linalg.norm(end - reference) for end in ends]
    *drifts, last = [motion.drifts for motion in motions]
    assert_near(-np.diff(np.log2(errors)), 4.0, 0.1)
    assert np.all(-np.diff(np.log2(drifts), axis=0) > 3.9)
    assert np.max(last) < 1e-13


def test_any_arrangement_conserves_energy_and_momentum(
    random_system, arrangement, free_motion
):
    truss = SpaceTruss(random_system(*arrangement, elastic_integrals=True))
    v = 0.1 * np.random.default_rng(3).standard_normal(truss.n)
    assert (
        np.max(free_motion(truss, 0.04, truss.dynamics.rest, v, step=1e-2).drifts)
        < 1e-9
    )


def test_published_actuators_do_no_work_on_the_modes(rng):
    """M (v'(Q) - v'(0)) is P Q; the modal rows of P are zero for `published` alone."""
    for truss, works in (
        (SpaceTruss.published(), False),
        (SpaceTruss.consistent(), True),
    ):
        q, v = (
            truss.dynamics.rest + 0.1 * rng.standard_normal(truss.n),
            0.03 * rng.standard_normal(truss.n),
        )
        x, p = Signals("x", {"q": q, "v": v}), Signals("p", truss.parameters)
        actuation, still = rng.standard_normal(truss.actuators), np.zeros(truss.modes)
        accelerations = [
            truss.derivative(
                np.float64(0),
                x,
                Signals("u", {"actuation": values, "modal_force": still}),
                p,
            )["v"]
            for values in (actuation, np.zeros(truss.actuators))
        ]
        terms = truss.dynamics.evaluate(q, v)
        expected = terms.actuation_matrix @ actuation
        assert np.abs(expected[truss.rigid :]).max() > 0.01
        if not works:
            expected[truss.rigid :] = 0.0
        force = terms.mass_matrix @ (accelerations[0] - accelerations[1])
        assert_near(force, expected, 1e-8 * np.abs(expected).max())


def test_units_follow_the_coordinates():
    truss = SpaceTruss.published()
    assert truss.coordinates.element_units()[0] == "m"
    assert truss.coordinates.element_units()[3] == "rad"
    assert truss.coordinates.element_units()[-1] == "kg**0.5*m"
    assert truss.actuation.element_units()[:6] == ("N",) * 3 + ("N*m",) * 3


@pytest.mark.parametrize(
    "choice, message",
    [
        ({"arm": "kuka"}, r"no arm 'kuka'; choose from: literal, jaco"),
        ({"modes": 7}, r"cannot keep 7 modes of 6"),
        ({"modes": 2.5}, r"cannot keep 2\.5 modes of 6"),
    ],
)
def test_errors(choice, message):
    with pytest.raises(ModelError, match=message):
        SpaceTruss.published(**choice)
