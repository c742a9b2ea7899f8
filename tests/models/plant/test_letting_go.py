"""Release of a robot: it takes its momentum and energy with it; truss and others keep their state."""

import numpy as np
import pytest

from trussflow.models import ModelError, SpaceTruss
from trussflow.models.plant.tunable_truss import TunableTruss


@pytest.mark.parametrize("kind", [SpaceTruss, TunableTruss])
def test_momentum_and_energy_are_sums_over_robots(kind, rng):
    """With P of all, P_i without robot i, P_0 of the truss alone: sum P_i = 3 P + P_0."""
    plant = kind.consistent()
    q = plant.dynamics.rest + 0.1 * rng.standard_normal(plant.n)
    v = rng.standard_normal(plant.n)

    def of(truss):
        q, v = (
            truss.parameters[f"initial_{name}"] for name in ("coordinates", "speeds")
        )
        return np.concatenate(
            [*truss.dynamics.momentum(q, v), [truss.dynamics.energy(q, v)]]
        )

    whole = plant.changed(start=q, speeds=v)
    three = [whole.without(robot) for robot in range(1, 5)]
    bare = three[3]
    for _ in range(3):
        bare = bare.without(1)
    assert bare.robots == 0
    np.testing.assert_allclose(
        sum(map(of, three)), 3 * of(whole) + of(bare), rtol=1e-12, atol=1e-10
    )
    # Each takes another part with it.
    assert len({round(float(of(each)[-1]), 6) for each in three}) == 4


def test_those_that_stay_keep_their_places(rng):
    plant = SpaceTruss.consistent(modes=3)
    q = plant.dynamics.rest + 0.1 * rng.standard_normal(plant.n)
    left = plant.changed(start=q).without(2)
    kept = left.parameters["initial_coordinates"]
    np.testing.assert_array_equal(kept[:13], q[:13])
    np.testing.assert_array_equal(kept[13:], q[20:])
    np.testing.assert_array_equal(
        left.parameters["initial_speeds"], np.zeros(plant.n - 7)
    )
    shown, before = (
        left.dynamics.grasp_displacement(kept),
        plant.dynamics.grasp_displacement(q),
    )
    np.testing.assert_allclose(shown, before[[0, 2, 3]], rtol=1e-14, atol=0.0)


def test_errors():
    plant = SpaceTruss.consistent(modes=1)
    with pytest.raises(ModelError, match=r"robot.*5"):
        plant.without(5)
