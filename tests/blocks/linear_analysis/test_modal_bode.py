"""Bode plots of the loops through modal forces: curves, names of modes, margins, unstable loops."""

import numpy as np

from trussflow.blocks import Diagram, MatrixGain, StateSpace, loop_margins, loop_transfer, modal_bode

FREQUENCIES = np.array([1.0, 3.0])  # Hz
OMEGA = 2.0 * np.pi * np.geomspace(0.5, 6.0, 50)


def loop(rate_gain):
    """Return two lightly damped modes under coupled rate feedback."""
    w = 2.0 * np.pi * FREQUENCIES
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(w**2), -np.diag(0.02 * w)]])
    rates = np.eye(4)[2:]
    diagram = Diagram("beam")
    plant, law = diagram.add(plant=StateSpace(A, rates.T, rates), law=MatrixGain(rate_gain))
    plant.y >> law >> plant.u
    return diagram


def test_each_curve_is_the_loop_of_one_mode_with_the_other_closed():
    diagram = loop([[-0.8, 0.3], [0.3, -0.5]])
    upper, lower = modal_bode(diagram, "plant.u", omega=OMEGA).axes
    margins = list(loop_margins(diagram, "plant.u").channels.values())
    for k, line in enumerate(upper.lines[:2]):
        one = loop_transfer(diagram, f"plant.u[{k}]")
        gain = one(1j * OMEGA)
        np.testing.assert_allclose(line.get_ydata(), 20.0 * np.log10(abs(gain)), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(line.get_xdata(), OMEGA / (2.0 * np.pi), rtol=1e-12)
        turns = np.exp(1j * np.radians(lower.lines[k].get_ydata()))
        np.testing.assert_allclose(turns, gain / abs(gain), rtol=0.0, atol=1e-9)
        text = f"plant/u[{k}]: mode {k + 1}, {FREQUENCIES[k]:.3g} Hz, ζ = 1.00%; margins"
        numbers = f"{20.0 * np.log10(margins[k].gain_up):.1f} dB, {margins[k].phase:.0f}°"
        assert line.get_label() == f"{text} {numbers}"


def test_a_slice_is_named_after_its_element():
    """The second mode belongs to the second element, also where this is the only one."""
    figure = modal_bode(loop([[-0.8, 0.0], [0.0, -0.5]]), "plant.u[1:2]", omega=OMEGA)
    assert figure.axes[0].lines[0].get_label().startswith("plant/u[1]: mode 2, 3 Hz")


def test_an_unstable_loop_has_its_poles_in_the_title():
    figure = modal_bode(loop([[0.8, 0.0], [0.0, -0.5]]), "plant.u")
    assert "unstable poles 0.337" in figure.axes[0].get_title()
    assert "margins" not in figure.axes[0].lines[0].get_label()
