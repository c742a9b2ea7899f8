"""The part of the mean-axes law that damps the modes of the truss."""

import numpy as np
from numpy.testing import assert_array_equal
from systems import respond

from trussflow.models import MeanAxesDesign, MeanAxesLaw, SpaceTruss


def test_the_modal_force_takes_energy_from_the_damped_modes_only(rng):
    dynamics, design = SpaceTruss.consistent().dynamics, MeanAxesDesign.shipped()
    rest, rates = (
        dynamics.rest[: dynamics.rigid_coordinates],
        rng.standard_normal(design.estimated_modes),
    )
    pose = {
        "reference_position": rest,
        "mean_position": rest,
        "joint_angles": rest[-dynamics.joints :],
    }
    force = respond(MeanAxesLaw(dynamics, design), modal_rate=rates, **pose)[
        "modal_force"
    ]
    damped = design.damped_modes
    assert damped > 0
    assert np.all(force[:damped] * rates[:damped] < 0.0)
    assert_array_equal(force[damped:], 0.0)
