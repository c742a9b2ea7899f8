"""Names that are given to signals once, on the diagram, for every analysis."""

import copy

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, series

from trussflow.blocks import (
    Diagram,
    Free,
    Gain,
    MatrixGain,
    StateSpace,
    Sum,
    linearize,
    loop_margins,
    loop_transfer,
    simulate,
    trim,
)
from trussflow.blocks.errors import BlockError, DiagramError, NameLookupError


def attitude():
    """Return a body with two axes under a law in a diagram of its own."""
    diagram, computer = Diagram("attitude"), Diagram("computer")
    law, trimmer = computer.add(
        law=MatrixGain([[-2.0, 0.0], [0.3, -1.0]]), trimmer=Sum("++")
    )
    law >> trimmer.u1
    computer.expose(angles=law.u, bias=trimmer.u2, torque=trimmer.y)
    computer.add_analysis_points(wanted=law.y)
    plant = StateSpace(
        np.array([[-1, 1, 0, 0], [-1, -1, 0, 0], [0, 0, -1, 1], [0, 0, -2, -1]]),
        np.array([[0, 0], [1, 0], [0, 0], [0, 1]]),
        np.array([[1, 0, 0, 0], [0, 0, 1, 0]]),
    )
    diagram.add(plant=plant, computer=computer)
    plant.y >> computer.angles
    computer.torque >> plant.u
    diagram.expose(bias=computer.bias)
    diagram.add_analysis_points(torque=plant.u, roll=plant.y[0], angles=plant.y)
    return diagram


def assert_same(found, expected):
    for matrix in "ABCD":
        assert_array_equal(getattr(found, matrix), getattr(expected, matrix))


def test_analyses_take_the_name_for_the_wire():
    diagram = attitude()
    found = linearize(diagram, "torque", ["roll", "computer.wanted"])
    assert_same(found, linearize(diagram, "plant.u", ["plant.y[0]", "computer.law.y"]))
    assert found.input_labels == ["torque[0]", "torque[1]"]
    assert found.output_labels == ["roll", "computer/wanted[0]", "computer/wanted[1]"]
    assert_same(
        loop_transfer(diagram, "torque[1]", openings="roll"),
        loop_transfer(diagram, "plant.u[1]", openings="plant.y[0]"),
    )
    assert list(loop_margins(diagram, "angles").channels) == ["angles[0]", "angles[1]"]
    at = trim(diagram, inputs={"bias": Free()}, outputs={"angles": [0.2, -0.1]})
    assert_near(at.outputs["angles"], [0.2, -0.1], 1e-8)


def test_what_is_logged_may_be_named_so_and_wires_may_start_there():
    diagram = attitude()
    outer = series(inner=diagram)
    outer.ground(diagram.bias)
    log = {"roll": "inner.roll", "angles": "inner.plant.y"}
    result = simulate(
        outer, 0.5, step=0.01, log=log, initial={"inner.plant.x": np.ones(4)}
    )
    assert_array_equal(result["roll"], result["angles"][:, 0])
    assert diagram.roll.block is diagram.plant
    gain = diagram.add(gain=Gain(1.0))
    diagram.roll >> gain
    assert linearize(diagram, "bias", gain.y).C.shape == (1, 4)


def test_the_name_stays_when_its_block_is_replaced_copied_or_moved():
    diagram = attitude()
    # with ports of the same names
    diagram.add(plant=StateSpace(-np.eye(2), np.eye(2), 3 * np.eye(2)))
    assert linearize(diagram, "torque", "roll", cut="torque").nstates == 2
    twin = copy.deepcopy(diagram)
    assert twin.roll.block is twin.plant
    diagram.add_analysis_points(roll=diagram.plant.y[1])
    assert linearize(diagram, "torque", "roll", cut="torque").C.tolist() == [[0.0, 3.0]]
    assert linearize(twin, "torque", "roll", cut="torque").C.tolist() == [[3.0, 0.0]]
    diagram.remove("plant")
    diagram.ground(diagram.computer.angles)
    with pytest.raises(
        NameLookupError,
        match=r"analysis point 'roll' of 'attitude' is at 'plant.y', but",
    ):
        linearize(diagram, "bias", "roll")


def test_names_are_unique_among_blocks_ports_and_points():
    diagram = attitude()
    for points, message in (
        (
            {"plant": diagram.plant.u},
            "cannot have a 'plant': it already has a block of that name",
        ),
        (
            {"bias": diagram.plant.u},
            "cannot have a 'bias': it already has a port of that name",
        ),
        ({"wires": diagram.plant.u}, "every diagram has an attribute of that name"),
        ({"inner": diagram.computer.law.y}, "for a block of a nested diagram, add the"),
        ({"other": "plant.u"}, "cannot name 'plant.u' 'other': give a port"),
    ):
        with pytest.raises(DiagramError, match=message):
            diagram.add_analysis_points(**points)
    message = "cannot have a 'roll': it already has an analysis point of that name"
    with pytest.raises(DiagramError, match=message):
        diagram.expose(roll=diagram.plant.y)
    with pytest.raises(DiagramError, match=message):
        diagram.add(roll=Gain(1.0))
    with pytest.raises(
        NameLookupError,
        match="analysis points: torque, roll, angles; blocks: plant, comp",
    ):
        linearize(diagram, "bias", "pitch")


def test_a_point_stays_at_the_name_of_its_block():
    """Although the block that it was added for goes to another diagram, under another name."""
    diagram, other = Diagram("d"), Diagram("other")
    first, second = diagram.add(a=Gain(1.0), b=Gain(2.0))
    diagram.add_analysis_points(point=first.y)
    diagram.add(a=Gain(5.0))
    other.add(b=first)
    assert diagram.port("point") == diagram.a.y
    diagram.remove("a")
    with pytest.raises(
        NameLookupError, match=r"'point' .* is at 'a\.y', but there is no"
    ):
        diagram.port("point")
    with pytest.raises(BlockError, match="cannot call 'b' 'z': it is in diagram 'd'"):
        second.named("z")


@pytest.mark.parametrize("crossed", [False, True])
def test_an_input_with_a_wire_for_each_element_is_injected_once(crossed):
    diagram = Diagram("d")
    source, gain = diagram.add(source=Gain([1.0, 1.0]), gain=Gain([2.0, 3.0]))
    diagram.ground(source.u)
    source.y[0] >> gain.u[int(crossed)]
    source.y[1] >> gain.u[1 - crossed]
    found = linearize(diagram, ["source.y"], ["gain.y"]).D
    expected = np.diag([2.0, 3.0])
    assert_array_equal(found, expected[:, ::-1] if crossed else expected)
