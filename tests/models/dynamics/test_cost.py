"""Operations that an evaluation of the equations takes, and how they grow with robots and modes."""

import numpy as np
import pytest
from sources import MISSIONS
from systems import series

from trussflow.blocks import Simulator
from trussflow.models import Frame, RobotArm, SpaceTruss, TrussDynamics, reduced_modes

RING = MISSIONS / "ring.toml"


def operations(*, robots=2, modes=2):
    """Return how many operations one right-hand side takes."""
    truss = reduced_modes(
        Frame.from_file(RING).structure(),
        modes,
        list(range(1, robots + 1)),
        attachments=False,
    )
    dynamics = TrussDynamics(
        modes=truss, arms=(RobotArm.literal(),) * robots, elastic_integrals=True
    )
    diagram = series("ring", truss=SpaceTruss(dynamics))
    diagram.ground(diagram.truss.actuation)
    simulator = Simulator(
        diagram, step=1e-3, log=["truss.modal_rate"], backend="interpreted"
    )
    derivative = simulator.prepared.programs[0]
    kernels = sum(
        call.inputs.shape[1] * call.kernel.function.n_instructions()
        for call in derivative.calls
    )
    return derivative.graph.n_instructions() + kernels


def test_cost_is_linear_in_robots():
    """Grasps on an axis of the ring are cheaper, as some elements are zero."""
    first, second = np.diff([operations(robots=count) for count in (2, 4, 6)])
    assert second == pytest.approx(first, rel=0.15)


def test_cost_is_at_most_quadratic_in_modes():
    none, some, twice = (operations(modes=count) for count in (0, 8, 16))
    assert twice - none < 4 * (some - none)
