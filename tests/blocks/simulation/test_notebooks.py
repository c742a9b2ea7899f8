"""Values of notebook cells: figures, tables as HTML, methods of results. No test needs IPython."""

import xml.etree.ElementTree as ET

import control
import matplotlib.pyplot as plt
import numpy as np
import pytest
from systems import decay, ring, series

from trussflow.blocks import (
    Constant,
    Gain,
    Integrator,
    OperatingPoint,
    TransferFunction,
    loop_margins,
    modal_bode,
    modal_table,
    plot,
    simulate,
    trim,
)


@pytest.fixture
def result():
    return simulate(decay(()), 1.0, step=0.1)


@pytest.fixture
def inline(monkeypatch):
    """Name the backend of notebooks."""
    name = "module://matplotlib_inline.backend_inline"
    monkeypatch.setattr(plt, "get_backend", lambda: name)
    yield
    plt.close("all")


def spring_loop():
    return ring(plant=TransferFunction([1.0], [1.0, 0.4, 1.0]), law=Gain(-0.5))


@pytest.mark.parametrize("kind", [plot, modal_bode])
@pytest.mark.usefixtures("inline")
def test_figure_is_shown_once(kind, result):
    """The steps of IPython: this method, if it raises the value of the cell, then all open figures."""
    figure = plot(result) if kind is plot else modal_bode(spring_loop(), "plant.u")
    assert plt.fignum_exists(figure.number)
    with pytest.raises(NotImplementedError):
        figure._ipython_display_()
    assert not plt.fignum_exists(figure.number)


def test_figure_stays_in_its_window(result):
    figure = plot(result)
    with pytest.raises(NotImplementedError):
        figure._ipython_display_()
    assert plt.fignum_exists(figure.number)
    plt.close(figure)


def cells(thing):
    """Return the rows of the tables of an object's HTML, which is well-formed."""
    root = ET.fromstring(f"<div>{thing._repr_html_()}</div>")
    return [["".join(cell.itertext()) for cell in row] for row in root.iter("tr")]


def test_margins_are_a_table():
    """python-control's margins of 0.5 / (s^2 + 0.4 s + 1)."""
    loop = spring_loop()
    up, phase, *_ = control.margin(control.tf([0.5], [1.0, 0.4, 1.0]))
    found = loop_margins(loop, "plant.u")
    header, (name, gain, degrees, *_) = cells(found)
    assert header == ["", "gain", "phase", "delay", "crossover", "disk"]
    assert name == "plant/u"
    assert gain == f"-inf to {up} dB"
    assert degrees == f"{phase:.1f}°"
    assert all(cell in repr(found) for cell in header)


def test_modes_and_operating_points_are_tables():
    header, row = cells(modal_table(TransferFunction([1.0], [1.0, 0.04, 4.0])))
    assert header == ["", "frequency", "damping ratio", "driven by"]
    assert row == ["mode 1", "0.3183 Hz", "1.000%", "u 100%"]
    point = trim(TransferFunction([1.0], [1.0, 0.4, 2.0]), inputs={"u": 3.0})
    assert ["input u", "3."] in cells(point)
    matrix = repr(OperatingPoint(inputs={"u": np.eye(2), "v": 1.0}))
    assert "input u  [[1. 0.] [0. 1.]]\n  input v  1." in matrix


def test_diagram_is_a_picture_with_names_as_text():
    diagram = series("<b>", one=Constant(1.0), integral=Integrator())
    assert diagram._repr_html_() is None  # else it would be preferred to the picture
    assert "&lt;b&gt;" in diagram._repr_svg_()
    assert ["input <b>", "1."] in cells(OperatingPoint(inputs={"<b>": 1.0}))
    assert ["out", "y"] in cells(diagram.integral)
