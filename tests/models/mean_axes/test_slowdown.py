"""Slowdown of a path that the actuators cannot follow."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.blocks import Session
from trussflow.models import Hardware, MeanAxesDesign, PathSlowdown, SpaceTruss
from trussflow.models.transport import Mission, mean_axes_transport

DYNAMICS = SpaceTruss.consistent().dynamics
DESIGN = MeanAxesDesign.shipped()
LIMITS = Hardware.flight().limits(SpaceTruss(DYNAMICS))


def test_reach_is_the_largest_demand_that_can_be_met():
    """All thrusters push along z, each with 5 N."""
    block = PathSlowdown(DYNAMICS, LIMITS, DESIGN)
    assert_allclose(block.parameters["reach"][2], 4 * 5.0, rtol=1e-9)


@pytest.mark.parametrize("part, halvings", [(0.019, 0), (-0.021, 4)])
def test_the_share_is_halved_every_second_of_a_missed_demand(part, halvings):
    block = PathSlowdown(DYNAMICS, LIMITS, DESIGN)
    missed = np.zeros(block.rigid)
    missed[3] = part * block.parameters["reach"][3]
    shares = []
    with Session(block, step=DESIGN.sample_time) as session:
        session.start(inputs={"missed": missed})
        for time in np.arange(0.5, 8.0):
            session.advance(time)
            shares.append(float(session.outputs["share"]))
    assert_array_equal(shares, 0.5 ** np.minimum(np.arange(8), halvings))


def test_a_short_miss_does_not_count():
    """The demand is met every 0.5 s."""
    block = PathSlowdown(DYNAMICS, LIMITS, DESIGN)
    with Session(block, step=DESIGN.sample_time) as session:
        session.start(inputs={"missed": np.zeros(block.rigid)})
        for k in range(1, 20):
            session.set(missed=np.full(block.rigid, 1e3 * (k % 2)))
            session.advance(0.5 * k)
        assert session.outputs["share"] == 1.0


@pytest.mark.campaign
def test_an_infeasible_mission_becomes_slower():
    """Without base 4, which fails after 10 s, the path is feasible with 8 % of its acceleration."""
    hardware = Hardware.flight()
    truss = hardware.mounted(SpaceTruss.consistent())
    diagram = mean_axes_transport(Mission.of_case(1), truss, hardware=hardware, seed=1)
    actuators, controller, trajectory = (
        diagram.blocks[n] for n in ("actuators", "controller", "trajectory")
    )
    diagram.expose(bases=actuators.port("base_effectiveness"), left=controller.share)
    diagram.expose(share=trajectory.share, position=truss.task_position)
    diagram.expose(reference=trajectory.position)
    worst = []
    with Session(diagram, step=1e-3) as session:
        for connected in (True, False):
            session.start(inputs={"bases": np.ones(4), "share": 1.0})
            errors = []
            for time in np.arange(0.1, 30.0, 0.1):
                session.advance(time)
                out = session.outputs
                errors.append(np.abs(out["position"] - out["reference"])[:6].max())
                session.set(share=out["left"] if connected else 1.0)
                session.set(bases=1.0 - np.eye(4)[3] * (time > 10.0))
            worst.append(max(errors))
    assert worst[0] < 0.05
    assert worst[1] > 0.2
