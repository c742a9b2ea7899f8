"""Wires that fit, and the messages of those that do not: golden texts with the user's line."""

import re

import numpy as np
import pytest
from systems import here, series

from trussflow.blocks.errors import (
    BlockError,
    DiagramError,
    NameLookupError,
    OpenInputError,
    WiringError,
)
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.library.algebra import Gain
from trussflow.blocks.library.groups import enabled
from trussflow.blocks.library.sources import Constant


class Truss(Block):
    f = Input((2,), unit="N", frame="body")
    torque = Input(unit="N*m")
    mode = Input()
    q = Output((2,), unit="m", frame="world")
    v = Output((2,), unit="m/s", frame="world")
    energy = Output(unit="J")


class Reference(Block):
    pos = Output((3,), unit="m", frame="world")
    mixed = Output((3,), unit=("m", "rad", "N"))
    clock = Output(unit="s")
    length = Output(unit="mm")
    celsius = Output(unit="degC")


class Consumer(Block):
    u = Input((2,), unit="N", frame="body")
    m = Input(unit="m")
    kelvin = Input(unit="K")
    mixed = Input((3,), unit=("m", "rad", "N"))
    grid = Input((2, 3))


class Nothing(Block):
    f = Input((0,), unit="N")


class Allocation(Block):
    f = Output((2,), unit="N", frame="body")


def build():
    diagram = Diagram("loop")
    diagram.add(truss=Truss(), traj=Reference(), user=Consumer(), alloc=Allocation())
    return diagram


def test_wrong_unit_and_frame_are_reported_with_a_suggestion():
    d = build()
    where = here(2)
    with pytest.raises(WiringError) as error:
        d.truss.q >> d.user.u
    assert str(error.value) == (
        "cannot wire 'truss.q' (shape (2,), unit m, frame world) >> "
        f"'user.u' (shape (2,), unit N, frame body)   [{where}]\n"
        "  unit 'm' does not fit 'N'\n"
        "  frame 'world' does not fit 'body'; rotate the vector\n"
        "  outputs that fit 'user.u' (shape (2,), unit N, frame body): "
        "'alloc.f' (shape (2,), unit N, frame body)"
    )


def test_energy_and_torque_have_the_same_dimension():
    d = build()
    d.connect(d.truss.energy, d.truss.torque)
    d.traj.mixed >> d.user.mixed


def test_units_of_ports_without_elements_are_compared():
    empty = Diagram("empty")
    mass, force = empty.add(mass=Constant(np.zeros(0), unit="kg"), force=Nothing())
    with pytest.raises(WiringError, match="unit 'kg' does not fit 'N'"):
        mass.y >> force.f


def test_driving_twice_names_both_lines():
    d = build()
    other = d.add("other", Allocation())
    first = here(1)
    d.alloc.f >> d.truss.f
    d.alloc.f >> d.truss.f  # again, as a cell of a notebook does
    second = here(2)
    with pytest.raises(WiringError) as error:
        other.f >> d.truss.f
    assert str(error.value) == (
        "cannot drive input 'truss.f' (shape (2,), unit N, frame body) twice   "
        f"[{second}]\n  it is already driven by 'alloc.f'   [{first}]"
    )
    with pytest.raises(WiringError, match=r"twice(.|\n)*already driven by 'alloc\.f'"):
        d.ground(d.truss.f)
    d.ground(d.truss.torque)
    with pytest.raises(WiringError, match="already driven by ground"):
        d.truss.energy >> d.truss.torque


def test_open_inputs_are_all_listed():
    d = build()
    d.alloc.f >> d.truss.f
    d.ground(d.user.u, d.user.m, d.user.kelvin, d.truss.torque, d.truss.mode)
    d.alloc.f[0] >> d.user.grid[0, 2]
    with pytest.raises(OpenInputError) as error:
        flatten(d)
    assert str(error.value) == (
        "inputs are not connected:\n"
        "  'user.mixed' (shape (3,), unit per element)\n"
        "  'user.grid' (shape (2, 3)): elements 0, 1, 3, 4, 5\n"
        "connect each, or set it to zero intentionally with diagram.ground(port)"
    )


def test_open_inputs_are_named_where_they_are_to_be_wired():
    inner, middle, diagram = Diagram("inner"), Diagram("middle"), Diagram("diagram")
    first, second, _ = inner.add(first=Gain(1.0), second=Gain(1.0), third=Gain(1.0))
    inner.expose(both=(first.u, second.u), out=first.y)
    middle.add(inner=enabled(inner))
    middle.expose(rate=middle.inner.both, enable=middle.inner.enable)
    diagram.add(middle=middle)
    with pytest.raises(OpenInputError) as error:
        flatten(diagram)
    assert re.findall(r"'([\w.]+)'", str(error.value)) == [
        "middle.rate",
        "middle.inner.third.u",
        "middle.enable",
    ]


def test_slices_may_share_an_input_but_not_an_element():
    d = build()
    d.traj.pos >> d.user.grid[0]
    d.traj.pos[:2] >> d.user.grid[1, 1:]
    with pytest.raises(
        WiringError, match=r"cannot drive input 'user\.grid\[1, :\]' .* twice"
    ):
        d.traj.pos >> d.user.grid[1, :]
    d.traj.pos[-1] >> d.user.grid[1, 0]
    with pytest.raises(WiringError, match="selects an element twice"):
        d.traj.pos[:2] >> d.user.mixed[[0, 0]]


@pytest.mark.parametrize(
    "index, message",
    [
        (3, r"index \[3\] does not fit 'traj\.pos' .*out of bounds"),
        (
            slice(1, 5),
            r"index \[1:5\] does not fit .*slice out of bounds for axis 0 with size 3",
        ),
        (slice(-4, None), r"index \[-4:\] does not fit"),
        (slice(2, 1), r"index \[2:1\] of 'traj\.pos' .* selects no element"),
        ((0, 0), r"index \[0, 0\] does not fit .*too many indices"),
        ("x", r"index \[x\] does not fit .*only integers"),
    ],
)
def test_index_that_does_not_fit(index, message):
    d = build()
    where = here(2)
    with pytest.raises(WiringError, match=message) as error:
        d.traj.pos[index]
    assert f"[{where}]" in str(error.value)


@pytest.mark.parametrize("value", [1.0, np.ones(2), "alloc.f", None])
def test_wiring_what_is_no_port(value):
    diagram = build()
    for wire, message in (
        (lambda: diagram.connect(value, diagram.truss.f), "it is not a port"),
        (lambda: diagram.alloc.f >> value, "it is not a port"),
        (lambda: value >> diagram.truss.f, r"it is not a port(.|\n)*Constant"),
    ):
        with pytest.raises(WiringError, match=message):
            wire()


def nested(d):
    """Wire to a port in an inner diagram that is not exposed."""
    box = series("box", truss=Truss())
    d.add(box=box)
    d.alloc.f >> box.truss.f


def in_another_diagram(d):
    Diagram("other").add(alloc=Allocation()).f >> d.truss.f


def assigned(d, name, value=3.0):
    setattr(d.truss, name, value)


REFUSED_WIRES = [
    (lambda d: d.traj.clock >> d.user.m, "unit 's' does not fit 'm'"),
    # A scale is no quiet conversion: the message gives the factor.
    (
        lambda d: d.traj.length >> d.user.m,
        r"unit 'mm' is 0\.001 'm'; insert a Gain with the",
    ),
    (
        lambda d: d.traj.celsius >> d.user.kelvin,
        "unit 'degC' has another zero than 'K'",
    ),
    (
        lambda d: d.traj.mixed[1] >> d.user.m,
        r"unit 'rad' does not fit 'm' \(element 0\)",
    ),
    (
        lambda d: d.connect(d.truss.f, d.truss.q),
        "an input cannot drive an output; an output drives an input",
    ),
    (
        lambda d: d.connect(d.truss.q, d.truss.v),
        "an output cannot drive an output; an output drives an input",
    ),
    (lambda d: d.traj.pos[:2][0], r"'traj\.pos' is already a slice"),
    (lambda d: list(d.truss.energy), r"index \[0\] does not fit 'truss\.energy'"),
    (
        lambda d: Allocation().f >> d.truss.f,
        r"cannot wire: this Allocation is in no diagram yet; add",
    ),
    (in_another_diagram, r"cannot wire 'truss\.f' in diagram 'other': its block"),
    (lambda d: d.alloc.f >> Truss().f, "its block is in no diagram"),
    (nested, r"'box\.truss\.f' in diagram 'loop'(.|\n)*expose"),
    (
        lambda d: assigned(d, "f"),
        r"cannot set 'f' of 'truss': blocks are frozen; connect it",
    ),
    (lambda d: assigned(d, "mass"), r"cannot set 'mass' of 'truss'.*build a new block"),
    (lambda d: d.alloc >> d.truss, r"'truss' has 3 inputs \(f, torque, mode\); name"),
    (lambda d: d.traj >> d.truss.f, r"'traj' has 5 outputs \(pos, mixed, clock"),
    (lambda d: d.plant, "blocks: truss, traj, user, alloc"),
    (lambda d: bool(d.truss.q), r"'truss\.q' is a port, not a number"),
    (lambda d: d.traj.pos + d.truss.q, r"shape \(2,\) does not fit \(3,\)"),
    (
        lambda d: d.traj.pos * d.truss.q,
        r"cannot compute .*'traj.pos'.*'multiply' of shapes \(3,\) and \(",
    ),
]


@pytest.mark.parametrize("attempt, message", REFUSED_WIRES)
def test_refused_wires_leave_the_diagram_as_it_was(attempt, message):
    """In a notebook the next cell tries again."""
    d = build()
    with pytest.raises((BlockError, DiagramError, NameLookupError), match=message):
        attempt(d)
    assert {"truss", "traj", "user", "alloc"} == {*d.blocks} - {"box"}
    assert not d.wires
    d.alloc.f >> d.user.u


def test_unknown_port_lists_those_there_are():
    d = build()
    with pytest.raises(NameLookupError) as error:
        _ = d.truss.force
    assert str(error.value) == (
        "block 'truss' (Truss) has no port 'force'; inputs: f, torque, mode; outputs: q, v, energy"
    )


def test_vectors_can_be_unpacked_and_scalars_cannot():
    d = build()
    x, y, z = d.traj.pos
    assert [port.full_path for port in (x, y, z)] == [
        f"traj.pos[{i}]" for i in range(3)
    ]
    assert [port.shape for port in d.user.grid] == [(3,), (3,)]
