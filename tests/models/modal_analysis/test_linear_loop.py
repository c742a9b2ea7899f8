"""The linear loop of the truss at rest: its poles, and that it is the loop that is flown."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import loop_transfer
from trussflow.models import ModelError, SpaceTruss
from trussflow.models.modal_analysis import HeldTruss, response
from trussflow.models.modal_analysis.linear_laws import linear_mission
from trussflow.models.transport import Mission, transport_diagram

WITH_MODAL_WORK = {None: 2.3996 + 61.76j, 2.0: 6.4212 + 61.73j, 4.0: 10.963 + 61.86j}
WITHOUT_MODAL_WORK = {2.0: -0.1974 + 16.23j, 4.0: -0.2908 + 16.21j}
"""Rightmost oscillating poles of the published loop, undamped, linear law [1/s]: from a linear
analysis that was made independently of this code."""

OMEGA = np.array([0.3, 2.0, 15.0, 60.0, 700.0])


def rightmost(matrix):
    values = np.linalg.eigvals(matrix)
    values = values[values.imag > 0.1]
    return complex(values[np.argmax(values.real)])


@pytest.mark.parametrize("bandwidth", list(WITH_MODAL_WORK))
def test_poles_with_work_on_the_modes(published_loop, bandwidth):
    loop = published_loop.loop(bandwidth=bandwidth, modal_actuation=True)
    assert abs(rightmost(loop.closed_matrix) / WITH_MODAL_WORK[bandwidth] - 1) < 0.01


@pytest.mark.parametrize("bandwidth", list(WITHOUT_MODAL_WORK))
def test_poles_without_work_on_the_modes(published_loop, bandwidth):
    loop = published_loop.loop(bandwidth=bandwidth)
    assert abs(rightmost(loop.closed_matrix) / WITHOUT_MODAL_WORK[bandwidth] - 1) < 0.01


def test_the_loop_is_the_one_that_is_flown(neutral_loop):
    """Put together from parts, or linearized as one diagram: the same loop gain."""
    mission = linear_mission(replace(Mission.of_case(1), position=np.zeros(3)))
    diagram = transport_diagram(mission, SpaceTruss.consistent())
    whole = loop_transfer(diagram, "feedback_allocation.demand[:34]")
    loop = neutral_loop.loop(bandwidth=mission.observer_bandwidth)
    scale = np.linalg.cholesky(loop.inertia)  # metres, radians and joints weigh in by energy
    expected, found = (
        np.linalg.inv(scale) @ response(model, OMEGA) @ scale for model in (whole, loop.demand_loop)
    )
    assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


def test_the_modal_force_is_a_wire(published_loop):
    """Opened at the wire, or put together from parts: the same modal loop."""
    mission = linear_mission(Mission.of_case(1))
    diagram = transport_diagram(mission, SpaceTruss.published())
    diagram.truss.modal_demand >> diagram.truss.modal_force
    whole = response(loop_transfer(diagram, "truss.modal_force"), OMEGA)
    parts = published_loop.loop(bandwidth=mission.observer_bandwidth, modal_actuation=True)
    expected = response(parts.modal_loop, OMEGA)
    assert np.abs(whole - expected).max() < 1e-9 * np.abs(expected).max()


def test_at_rest_the_plants_differ_in_damping_alone(published_loop, neutral_loop):
    """Exact truss integrals change nothing to first order; damping is put in exactly."""
    damped = published_loop.plant(damping=0.005)
    assert np.abs(damped.A - neutral_loop.plant().A).max() < 1e-9 * np.abs(damped.A).max()
    assert np.abs(damped.A - published_loop.plant().A).max() > 0.01


def test_opened_modes_are_modes_without_work(published_loop):
    """Opening the loops at all modal forces leaves the closed loop without modal work."""
    opened = published_loop.loop(bandwidth=4.0, modal_actuation=True).modal_loop
    without = published_loop.loop(bandwidth=4.0, modal_actuation=False)
    assert rightmost(opened.A) == pytest.approx(rightmost(without.closed_matrix), rel=1e-9)


@pytest.mark.parametrize("numbers", [range(34), range(34, 40), [2], [2, 36]])
def test_closing_any_channels_closes_the_loop(published_loop, numbers):
    loop = published_loop.loop(bandwidth=2.0, modal_actuation=True)
    part = loop.closed_but(numbers)
    closed = part.A - part.B @ np.linalg.solve(np.eye(part.ninputs) + part.D, part.C)
    assert rightmost(closed) == pytest.approx(rightmost(loop.closed_matrix), rel=1e-9)


def test_mode_neutral_feedback_leaves_no_loop_at_the_modes(neutral_loop):
    gains = response(neutral_loop.loop(bandwidth=4.0).modal_loop, OMEGA)
    assert np.abs(gains).max() < 1e-9


def test_names_of_channels(published_loop):
    names = published_loop.loop().channel_names()
    assert names[:7] == ["x", "y", "z", "phi", "theta", "psi", "theta_1_1"]
    assert names[33:35] == ["theta_4_7", "mode_1"]
    assert len(names) == 40


def test_fastest_pole_of_pd(published_loop):
    """k_d over the least eigenvalue of the rigid inertia is the fastest rate there is."""
    loop = published_loop.loop("pd")
    values = np.linalg.eigvals(loop.closed_matrix)
    fastest = published_loop.mission.derivative_gain / np.linalg.eigvalsh(loop.inertia)[0]
    assert -values.real.min() == pytest.approx(fastest, rel=0.05)


def test_loops_that_there_are_not(published_loop, neutral_loop):
    with pytest.raises(ModelError, match="no controller 'lqr'; choose from: ismc, smc, pd"):
        published_loop.loop("lqr")
    with pytest.raises(ModelError, match="PD law has no disturbance observer"):
        published_loop.loop("pd", bandwidth=4.0)
    with pytest.raises(ModelError, match="choose the published allocation"):
        neutral_loop.loop("pd")


def test_a_controller_cannot_believe_in_more_modes(consistent):
    few = replace(consistent, modes=consistent.modes.truncated(2))
    with pytest.raises(ModelError, match="the same robots and no more modes"):
        transport_diagram(Mission.of_case(1), SpaceTruss(few), believed=consistent)


def test_a_controller_may_believe_in_fewer_modes(consistent):
    """Neutral to the two modes it knows, it works on the others."""
    few = replace(consistent, modes=consistent.modes.truncated(2))
    held = HeldTruss(SpaceTruss(consistent), believed=few)
    gains = np.abs(response(held.loop().modal_loop, np.array([20.0])))[0].max(axis=1)
    assert gains[:2].max() < 1e-9
    assert gains[2:].min() > 1e-6
