"""Bode plots of the loops through modal forces: curves, names of modes, margins, unstable loops."""

from unittest.mock import patch

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import assert_near

from trussflow.blocks import (
    Diagram,
    DiscreteStateSpace,
    MatrixGain,
    StateSpace,
    loop_margins,
    loop_transfer,
    modal_bode,
)
from trussflow.blocks.errors import LinearAnalysisError

FREQUENCIES = np.array([1.0, 3.0])  # Hz
OMEGA = 2.0 * np.pi * np.geomspace(0.5, 6.0, 50)


def loop(rate_gain, period=None):
    """Return two lightly damped modes under coupled rate feedback, or both sampled."""
    w = 2.0 * np.pi * FREQUENCIES
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(w**2), -np.diag(0.02 * w)]])
    rates = np.eye(4)[2:]
    diagram = Diagram("beam")
    model = StateSpace(A, rates.T, rates)
    if period is not None:
        held = control.c2d(control.ss(A, rates.T, rates, 0), period)
        model = DiscreteStateSpace(held.A, held.B, rates, sample_time=period)
    plant, law = diagram.add(plant=model, law=MatrixGain(rate_gain))
    plant.y >> law >> plant.u
    return diagram


def test_each_curve_is_the_loop_of_one_mode_with_the_other_closed():
    diagram = loop([[-0.8, 0.3], [0.3, -0.5]])
    upper, lower = modal_bode(diagram, "plant.u", omega=OMEGA).axes
    margins = list(loop_margins(diagram, "plant.u").channels.values())
    for k, line in enumerate(upper.lines[:2]):
        one = loop_transfer(diagram, f"plant.u[{k}]")
        gain = one(1j * OMEGA)
        assert_allclose(
            line.get_ydata(), 20.0 * np.log10(abs(gain)), rtol=1e-9, atol=1e-9
        )
        assert_allclose(line.get_xdata(), OMEGA / (2.0 * np.pi), rtol=1e-12)
        turns = np.exp(1j * np.radians(lower.lines[k].get_ydata()))
        assert_near(turns, gain / abs(gain), 1e-9)
        text = f"plant/u[{k}]: drives mode {k + 1}, {FREQUENCIES[k]:.3g} Hz, ζ = 1.00%; margins"
        numbers = (
            f"{20.0 * np.log10(margins[k].gain_up):.1f} dB, {margins[k].phase:.0f}°"
        )
        assert line.get_label() == f"{text} {numbers.replace('inf', '∞')}"


def test_a_slice_is_named_after_its_element():
    """The second mode belongs to the second element, also where this is the only one."""
    figure = modal_bode(loop([[-0.8, 0.0], [0.0, -0.5]]), "plant.u[1:2]", omega=OMEGA)
    assert (
        figure.axes[0]
        .lines[0]
        .get_label()
        .startswith("plant/u[1]: drives mode 2, 3 Hz")
    )


def test_modes_of_a_sampled_plant_have_the_frequencies_of_the_continuous_one():
    figure = modal_bode(
        loop([[-0.8, 0.0], [0.0, -0.5]], period=0.01), "plant.u", omega=OMEGA
    )
    for k, line in enumerate(figure.axes[0].lines[:2]):
        assert (
            f": drives mode {k + 1}, {FREQUENCIES[k]:.3g} Hz, ζ = 1.00%; margins"
            in line.get_label()
        )


def test_a_given_loop_is_used_and_no_multi_loop_margin_is_searched():
    diagram = loop([[-0.8, 0.0], [0.0, -0.5]])
    given = loop_transfer(loop([[-0.4, 0.0], [0.0, -0.5]]), "plant.u")
    with patch("control.disk_margins", side_effect=AssertionError):
        figure = modal_bode(diagram, "plant.u", loop=given, omega=OMEGA)
    with pytest.raises(
        LinearAnalysisError,
        match=r"has 2 channels, but 'plant.u\[1:2\]' has 1 elements",
    ):
        modal_bode(diagram, "plant.u[1:2]", loop=given)
    with pytest.raises(LinearAnalysisError, match=r"'plant\.y' is an output; name"):
        modal_bode(diagram, "plant.y")
    decibels = figure.axes[0].lines[0].get_ydata()
    assert_allclose(
        decibels, 20.0 * np.log10(abs(given(1j * OMEGA)[0, 0])), rtol=1e-9, atol=1e-9
    )


def test_an_unstable_loop_has_its_poles_in_the_title():
    figure = modal_bode(loop([[0.8, 0.0], [0.0, -0.5]]), "plant.u")
    assert "unstable poles 0.337" in figure.axes[0].get_title()
    assert "margins" not in figure.axes[0].lines[0].get_label()
