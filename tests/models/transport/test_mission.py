"""Missions: the numbers of the paper's Section 4."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.models import ModelError, SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

ROUND_OFF = 1e-14  # of turning degrees into radians, and of a few quotients


@pytest.mark.parametrize(
    "case, way, gains",
    [(1, [0, 0, 6, 0, 0, 0], (4.0, 0.3)), (2, [6, 6, 0, 0, 0, np.pi / 3], (2.0, 0.52))],
)
def test_cases_of_the_paper(case, way, gains):
    mission = Mission.of_case(case)
    assert_allclose(mission.displacement(34), way + [0] * 28, rtol=ROUND_OFF)
    assert (mission.observer_bandwidth, mission.reaching_gain) == gains


def test_weights():
    weights = Mission.of_case(1).actuator_weights(4, 28)
    assert_allclose(weights[:6], [1, 1, 1, 2, 1.2, 1 / 6], rtol=ROUND_OFF)
    assert_array_equal(weights[24:], np.ones(28))


@pytest.mark.parametrize(
    "case, options, message",
    [
        (3, {}, "no transport case 3; choose from: 1, 2"),
        (
            1,
            {"allocation": "lp"},
            "no allocation 'lp'; choose from: published, mode-neutral",
        ),
        (1, {"controller": "lqr"}, "no controller 'lqr'; choose from: ismc, smc, pd"),
    ],
)
def test_unknown_choices(case, options, message):
    with pytest.raises(ModelError, match=message):
        transport_diagram(Mission.of_case(case), SpaceTruss.published(), **options)
