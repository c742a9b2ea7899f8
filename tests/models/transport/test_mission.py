"""Missions: the numbers of the source's Section 4."""

import numpy as np
import pytest

from trussflow.models import ModelError, SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

ROUND_OFF = 1e-14  # of turning degrees into radians, and of a few quotients


def test_case_1_is_six_metres_along_z():
    mission = Mission.of_case(1)
    assert np.array_equal(mission.displacement(34), [0, 0, 6, *[0] * 31])
    assert (mission.observer_bandwidth, mission.reaching_gain) == (4.0, 0.3)


def test_case_2_turns_by_sixty_degrees():
    mission = Mission.of_case(2)
    assert np.allclose(mission.displacement(34)[:6], [6, 6, 0, 0, 0, np.pi / 3], rtol=ROUND_OFF, atol=0)
    assert (mission.observer_bandwidth, mission.reaching_gain) == (2.0, 0.52)


def test_weights():
    weights = Mission.of_case(1).actuator_weights(4, 28)
    assert np.allclose(weights[:6], [1, 1, 1, 2, 1.2, 1 / 6], rtol=ROUND_OFF, atol=0)
    assert np.array_equal(weights[24:], np.ones(28))


def test_unknown_case():
    with pytest.raises(ModelError, match=r"no transport case 3; choose from: 1, 2"):
        Mission.of_case(3)


def test_unknown_allocation():
    with pytest.raises(ModelError, match=r"no allocation 'lp'; choose from: published, mode-neutral"):
        transport_diagram(Mission.of_case(1), SpaceTruss.published(), allocation="lp")


def test_unknown_controller():
    with pytest.raises(ModelError, match=r"no controller 'lqr'; choose from: ismc, smc, pd"):
        transport_diagram(Mission.of_case(1), SpaceTruss.published(), controller="lqr")
