"""Sampled loops apart: against the exact lifted model, known limits, and the simulation of a period."""

from dataclasses import replace

import control
import numpy as np
import pytest
from flight.sampled_loop import SampledLoop, spectral_radius
from numpy.testing import assert_allclose
from systems import ring

from trussflow.blocks import DiscreteStateSpace, Gain, Session, StateSpace, linearize
from trussflow.blocks.linear_analysis.margins import channel_disks, frequencies_about

H = 0.1


def loop_diagram():
    """Return an unstable plant of two states and commands, and a sampled controller of two states."""
    diagram = ring(
        plant=StateSpace(
            [[0.0, 1.0], [1.5, -0.1]], [[0.0, 0.2], [1.0, 0.5]], np.eye(2)
        ),
        law=DiscreteStateSpace(
            [[0.3, 0.1], [0.0, 0.5]],
            [[0.2, 0.1], [0.3, 0.2]],
            [[-1.0, -0.2], [0.1, -0.4]],
            [[-2.5, -1.2], [0.1, -0.3]],
            sample_time=H,
        ),
        sign=Gain([1.0, 1.0]).sampled(H),
    )
    diagram.expose(y=diagram.plant.y)
    return diagram


@pytest.fixture(scope="module")
def loop():
    with Session(loop_diagram(), step=0.01) as session:
        session.advance(0.5)
        return SampledLoop.of(session, "sign.y", ["law.x"], ["plant.x"])


def test_poles_are_those_of_the_lifted_diagram(loop):
    exact = linearize(loop_diagram(), "plant.u", "plant.u").poles()
    poles = np.linalg.eigvals(loop.closed())
    found, expected = (np.sort_complex(z[np.abs(z) > 1e-9]) for z in (poles, exact))
    assert_allclose(found, expected, rtol=1e-8)
    assert spectral_radius(loop.closed()) < 1.0


@pytest.mark.parametrize("where", ["actuators", "sensors"])
def test_loop_gain_closed_is_the_loop(loop, where):
    """Closed with gains of all channels at once, as `closed` has them; and disk margins python-control's."""
    model = loop.loop_gain(where)
    for gains in ([1.0, 1.0], [0.7, 1.3]):
        found = np.linalg.eigvals(model.A - (model.B * gains) @ model.C)
        law = loop.controller
        scaled = np.diag(gains) * law if where == "actuators" else law * np.diag(gains)
        expected = np.linalg.eigvals(replace(loop, controller=scaled).closed())
        assert_allclose(
            np.sort_complex(found), np.sort_complex(expected), rtol=1e-9, atol=1e-12
        )
    omega = frequencies_about(loop.continuous_poles(), 0.1, np.pi / H, 200)
    disks, at = channel_disks(model, omega)
    for k in range(2):
        other = 1 - k
        A = model.A - model.B[:, [other]] @ model.C[[other]]
        alone = control.StateSpace(A, model.B[:, [k]], model.C[[k]], 0, H)
        scan = np.clip(
            at[k] * (1.0 + np.linspace(-0.05, 0.05, 4001)), omega[0], omega[-1]
        )
        assert disks[k] == pytest.approx(control.disk_margins(alone, scan)[0], rel=1e-8)
        on_grid = control.disk_margins(alone, omega)[0]
        assert disks[k] <= on_grid * (1 + 1e-12)  # round-off


def test_a_known_limit():
    """X' = u, c = -K y: z = 1 - K h, stable for K h < 2, and with a sample of delay for K h < 1."""
    plant = control.StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]])
    law = control.ss([], [], [], [[-1.0 / H]], H)
    loop = SampledLoop(plant=plant, controller=law)
    assert (
        spectral_radius(loop.closed(actuators=1.999))
        < 1.0
        < spectral_radius(loop.closed(actuators=2.001))
    )
    assert spectral_radius(loop.closed(actuators=0.999, late=1)) < 1.0
    assert spectral_radius(loop.closed(actuators=1.001, late=1)) > 1.0
