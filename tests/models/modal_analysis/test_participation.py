"""Participation and how feedback moves poles."""

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh

from trussflow.blocks import OperatingPoint, loop_transfer, modal_table
from trussflow.models import SpaceTruss
from trussflow.models.modal_analysis import poles
from trussflow.models.modal_analysis.participation import actuator_names, strongest
from trussflow.models.transport import Mission, transport_diagram

STEP = 1e-6


@pytest.fixture(scope="module")
def loop(published_loop):
    return published_loop.loop(modal_actuation=True)


@pytest.fixture(scope="module")
def found(loop):
    return poles(loop, 4)


def moved(matrix, near):
    values = np.linalg.eigvals(matrix)
    return complex(values[np.argmin(np.abs(values - near))])


def test_participation_sums_to_one(found):
    for pole in found:
        assert sum(pole.participation.values()) == pytest.approx(1.0)
        assert pole.modal_participation.sum() == pytest.approx(pole.participation["modes"])


def test_rightmost_first_and_damping(found):
    assert [p.value.real for p in found] == sorted((p.value.real for p in found), reverse=True)
    first = found[0]
    assert first.damping_ratio == pytest.approx(-first.value.real / first.frequency)
    assert first.damping_ratio < 0
    assert first.participation["modes"] > 0.9  # it is a mode of the truss that grows


def test_rates_of_channels_and_modes_are_derivatives(loop, found):
    """More feedback in one channel moves the pole as the eigenvectors say."""
    pole = found[0]
    for number, rate in ((3, pole.channel_rates[3]), (36, pole.modal_rates[2])):
        part = loop.closed_but([number])
        ends = [moved(part.A - (1 + e) * part.B @ part.C, pole.value) for e in (STEP, -STEP)]
        assert (ends[0] - ends[1]) / (2 * STEP) == pytest.approx(rate, rel=1e-4)


def test_all_channels_together_are_all_actuators_together(found):
    for pole in found:
        assert pole.channel_rates.sum() == pytest.approx(pole.actuator_rates.sum(), rel=1e-6)


@pytest.mark.campaign
def test_rate_of_an_actuator_is_a_derivative(found):
    """Broken at the actuator's own wire in the diagram."""
    truss = SpaceTruss(SpaceTruss.published().dynamics, modal_actuation=True)
    diagram = transport_diagram(Mission.of_case(1), truss, observer=False, allocation="published")
    linear = OperatingPoint(parameters={"controller.beta": 1.0, "controller.eta": 0.0})
    part = loop_transfer(diagram, "truss.actuation[20]", at=linear)
    pole = found[0]
    ends = [moved(part.A - (1 + e) * part.B @ part.C, pole.value) for e in (STEP, -STEP)]
    assert (ends[0] - ends[1]) / (2 * STEP) == pytest.approx(pole.actuator_rates[20], rel=1e-4)
    assert actuator_names(4, 28)[20] == "F_4z"


def test_strongest_lists_what_drives_to_the_right():
    assert strongest(np.array([1.0 + 1j, -3.0, 2.0]), ["a", "b", "c"]) == "c +2, a +1"


def test_modal_table_of_the_truss_has_the_modes_of_its_mass_and_stiffness():
    """Without damping; 34 rigid coordinates have no frequency."""
    truss = SpaceTruss.published()
    terms = truss.dynamics.evaluate(truss.dynamics.rest, np.zeros(truss.n))
    stiffness = block_diag(np.zeros((truss.rigid, truss.rigid)), np.diag(truss.dynamics.modes.stiffness))
    squares, shapes = eigh(stiffness, terms.mass_matrix)
    effects = (shapes[: truss.rigid].T @ terms.actuation_matrix[: truss.rigid]) ** 2
    found = modal_table(truss, "actuation").modes
    assert [2 * np.pi * m.frequency for m in found] == pytest.approx(
        np.sqrt(squares[truss.rigid :]), rel=1e-8
    )
    for mode, effect in zip(found, effects[truss.rigid :], strict=True):
        np.testing.assert_allclose(list(mode.shares.values()), effect / effect.sum(), rtol=0, atol=1e-7)
