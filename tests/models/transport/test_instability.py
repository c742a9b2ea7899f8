"""With actuators that work on the modes, the published loop is unstable; ours is not."""

from dataclasses import replace

import campaign
import numpy as np
import pytest

from trussflow.blocks import Simulator
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

GROWTH = {None: 2.40, 2.0: 6.42, 4.0: 10.96}
"""Real part of the rightmost poles [1/s] by observer bandwidth [1/s], from a linear analysis of
the six undamped modes that was made independently of this code."""

FOLDS = 12.0
"""Growth is watched over e^12, from far below to well within the linear range."""


def modal_rate(bandwidth, allocation, duration):
    """Hold the truss, its modes barely disturbed, under linear laws (beta = 1, eta = 0)."""
    truss = SpaceTruss(SpaceTruss.published().dynamics, modal_actuation=True)
    mission = replace(
        Mission.of_case(1),
        position=np.zeros(3),
        exponent=1.0,
        switching_gain=0.0,
        observer_bandwidth=bandwidth or 1.0,
    )
    diagram = transport_diagram(
        mission, truss, observer=bandwidth is not None, allocation=allocation
    )
    start = np.zeros(truss.n)
    start[truss.rigid :] = 1e-8
    simulator = Simulator(diagram, step=1e-3, log=["truss.modal_rate"])
    return simulator.run(duration, initial={"truss.v": start})


@pytest.mark.parametrize("bandwidth", [4.0, *map(campaign.only, (None, 2.0))])
def test_published_allocation_grows_at_the_rate_of_the_linear_poles(bandwidth):
    """Fitted to the size of the modal rates over the second half of the run."""
    expected = GROWTH[bandwidth]
    result = modal_rate(bandwidth, "published", round(FOLDS / expected, 1))
    size = np.linalg.norm(result["truss.modal_rate"].values, axis=1)
    window = 100  # one period of the growing oscillation, near 62 rad/s
    smooth = np.sqrt(np.convolve(size**2, np.ones(window) / window, mode="valid"))
    late = slice(len(smooth) // 2, None)
    time = result["time"].values[: len(smooth)]
    rate = np.polyfit(time[late], np.log(smooth[late]), 1)[0]
    assert rate == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("duration", [1.0, campaign.only(10.0)])
def test_mode_neutral_allocation_does_not_grow(duration):
    """The same loop with feedback allocated so that it does no work on the modes."""
    size = np.abs(
        modal_rate(4.0, "mode-neutral", duration)["truss.modal_rate"].values
    ).max(axis=1)
    assert (
        size[-len(size) // 4 :].max() < 1.1 * size[: len(size) // 4].max()
    )  # undamped modes keep their size
