"""What a wire may join, and the message when it may not: golden texts with the user's line."""

import re
import sys

import numpy as np
import pytest

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import (
    BlockError,
    DiagramError,
    NameLookupError,
    OpenInputError,
    WiringError,
)
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.library.algebra import Gain
from trussflow.blocks.library.groups import enabled


class Truss(Block):
    f = Input((2,), unit="N", frame="body")
    torque = Input(unit="N*m")
    mode = Input(dtype=int)
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


class Allocation(Block):
    f = Output((2,), unit="N", frame="body")


def here(ahead):
    """Return ``file:line`` of a line some lines after the call."""
    frame = sys._getframe(1)
    return f"{frame.f_code.co_filename}:{frame.f_lineno + ahead}"


def build():
    diagram = Diagram("loop")
    return (diagram, *diagram.add(truss=Truss(), traj=Reference(), user=Consumer(), alloc=Allocation()))


def test_wrong_unit_and_frame_are_reported_with_a_suggestion():
    _, truss, _, user, _ = build()
    where = here(2)
    with pytest.raises(WiringError) as error:
        truss.q >> user.u
    assert str(error.value) == (
        "cannot wire 'truss.q' (shape (2,), unit m, frame world) >> "
        f"'user.u' (shape (2,), unit N, frame body)   [{where}]\n"
        "  unit 'm' does not fit 'N'\n"
        "  frame 'world' does not fit 'body'; rotate the vector\n"
        "  outputs that fit 'user.u' (shape (2,), unit N, frame body): "
        "'alloc.f' (shape (2,), unit N, frame body)"
    )


def test_metres_into_seconds_and_millimetres_into_metres():
    """A scale is no quiet conversion: the message gives the factor."""
    _, _, traj, user, _ = build()
    with pytest.raises(WiringError, match="unit 's' does not fit 'm'"):
        traj.clock >> user.m
    with pytest.raises(WiringError, match=r"unit 'mm' is 0\.001 'm'; insert a Gain with the"):
        traj.length >> user.m
    with pytest.raises(WiringError, match="unit 'degC' has another zero than 'K'"):
        traj.celsius >> user.kelvin


def test_energy_and_torque_have_the_same_dimension():
    diagram, truss, *_ = build()
    diagram.connect(truss.energy, truss.torque)


def test_units_per_element_are_compared_element_by_element():
    _, truss, traj, user, _ = build()
    traj.mixed >> user.mixed
    with pytest.raises(WiringError, match=r"unit 'rad' does not fit 'm' \(element 0\)"):
        traj.mixed[1] >> user.m
    with pytest.raises(WiringError, match=r"'N' does not fit 'J|'N' does not fit 'N\*m'"):
        traj.mixed[2] >> truss.torque


def test_wrong_dtype():
    diagram, truss, *_ = build()

    class Real(Block):
        y = Output()

    real = diagram.add(real=Real())
    with pytest.raises(WiringError, match="dtype float64 does not fit int64"):
        real >> truss.mode


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ("f", "q", "the wire runs backwards; an output drives an input"),
        ("f", "torque", "both are inputs; an output drives an input"),
        ("q", "v", "both are outputs; an output drives an input"),
    ],
)
def test_wrong_direction(first, second, message):
    diagram, truss, *_ = build()
    with pytest.raises(WiringError, match=message):
        diagram.connect(truss.port(first), truss.port(second))


def test_driving_twice_names_both_lines():
    diagram, truss, _, _, alloc = build()
    other = diagram.add("other", Allocation())
    first = here(1)
    alloc.f >> truss.f
    alloc.f >> truss.f  # again, as a cell of a notebook does
    second = here(2)
    with pytest.raises(WiringError) as error:
        other.f >> truss.f
    assert str(error.value) == (
        "cannot drive input 'truss.f' (shape (2,), unit N, frame body) twice   "
        f"[{second}]\n  it is already driven by 'alloc.f'   [{first}]"
    )
    with pytest.raises(WiringError, match=r"twice(.|\n)*already driven by 'alloc\.f'"):
        diagram.ground(truss.f)
    diagram.ground(truss.torque)
    with pytest.raises(WiringError, match="already driven by ground"):
        truss.energy >> truss.torque


def test_open_inputs_are_all_listed():
    diagram, truss, _, user, alloc = build()
    alloc.f >> truss.f
    diagram.ground(user.u, user.m, user.kelvin, truss.torque, truss.mode)
    alloc.f[0] >> user.grid[0, 2]
    with pytest.raises(OpenInputError) as error:
        flatten(diagram)
    assert str(error.value) == (
        "inputs are driven by nothing:\n"
        "  'user.mixed' (shape (3,), unit per element)\n"
        "  'user.grid' (shape (2, 3)): elements 0, 1, 3, 4, 5\n"
        "wire each, or leave it at zero on purpose with diagram.ground(port)"
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
    _, _, traj, user, _ = build()
    traj.pos >> user.grid[0]
    traj.pos[:2] >> user.grid[1, 1:]
    with pytest.raises(WiringError, match=r"cannot drive input 'user\.grid\[1, :\]' .* twice"):
        traj.pos >> user.grid[1, :]
    traj.pos[-1] >> user.grid[1, 0]
    with pytest.raises(WiringError, match="names an element twice"):
        traj.pos[:2] >> user.mixed[[0, 0]]


@pytest.mark.parametrize(
    ("index", "message"),
    [
        (3, r"index \[3\] does not fit 'traj\.pos' .*out of bounds"),
        (slice(1, 5), r"index \[1:5\] does not fit .*slice out of bounds for axis 0 with size 3"),
        (slice(-4, None), r"index \[-4:\] does not fit"),
        (slice(2, 1), r"index \[2:1\] of 'traj\.pos' .* selects nothing"),
        ((0, 0), r"index \[0, 0\] does not fit .*too many indices"),
        ("x", r"index \[x\] does not fit .*only integers"),
    ],
)
def test_index_that_does_not_fit(index, message):
    _, _, traj, _, _ = build()
    where = here(2)
    with pytest.raises(WiringError, match=message) as error:
        traj.pos[index]
    assert f"[{where}]" in str(error.value)


def test_slice_of_a_slice():
    _, _, traj, _, _ = build()
    with pytest.raises(WiringError, match=r"'traj\.pos' is already a slice"):
        traj.pos[:2][0]


def test_block_in_no_diagram_or_another_one():
    _, truss, *_ = build()
    with pytest.raises(BlockError, match=r"cannot wire: this Allocation is in no diagram yet; add"):
        Allocation().f >> truss.f
    diagram = Diagram("other")
    other = diagram.add(alloc=Allocation())
    with pytest.raises(WiringError, match=r"cannot wire 'truss\.f' in diagram 'other': its block"):
        other.f >> truss.f
    with pytest.raises(WiringError, match="its block is in no diagram"):
        other.f >> Truss().f


@pytest.mark.parametrize("value", [1.0, np.ones(2), "alloc.f", None])
def test_wiring_what_is_no_port(value):
    diagram, truss, _, _, alloc = build()
    with pytest.raises(WiringError, match="it is not a port"):
        diagram.connect(value, truss.f)
    with pytest.raises(WiringError, match="it is not a port"):
        alloc.f >> value
    with pytest.raises(WiringError, match=r"it is not a port(.|\n)*Constant"):
        value >> truss.f


def test_assignment_is_no_wiring():
    _, truss, _, _, alloc = build()
    with pytest.raises(BlockError, match=r"cannot set 'f' of 'truss': blocks are frozen; wire it"):
        truss.f = alloc.f
    with pytest.raises(BlockError, match=r"cannot set 'mass' of 'truss'.*build a new block"):
        truss.mass = 3.0


def test_wiring_a_block_needs_exactly_one_port():
    _, truss, traj, _, alloc = build()
    with pytest.raises(NameLookupError, match=r"'truss' has 3 inputs \(f, torque, mode\); name"):
        alloc >> truss
    with pytest.raises(NameLookupError, match=r"'traj' has 5 outputs \(pos, mixed, clock"):
        traj >> truss.f


def test_unknown_port_lists_those_there_are():
    diagram, truss, *_ = build()
    with pytest.raises(NameLookupError) as error:
        _ = truss.force
    assert str(error.value) == (
        "block 'truss' (Truss) has no port 'force'; inputs: f, torque, mode; outputs: q, v, energy"
    )
    with pytest.raises(NameLookupError, match="blocks: truss, traj, user, alloc"):
        _ = diagram.plant


def test_port_has_no_truth_value():
    _, truss, *_ = build()
    with pytest.raises(WiringError, match=r"'truss\.q' is a port, not a number"):
        bool(truss.q)


def test_wires_of_nested_diagrams_must_be_exposed():
    outer, inner = Diagram("outer"), Diagram("inner")
    inner.add(truss=Truss())
    outer.add(box=inner, alloc=Allocation())
    with pytest.raises(WiringError, match=r"'box\.truss\.f' in diagram 'outer'(.|\n)*expose"):
        outer.alloc.f >> inner.truss.f


def test_error_leaves_the_diagram_as_it_was():
    """In a notebook the next cell tries again."""
    diagram, truss, traj, user, alloc = build()
    with pytest.raises(WiringError):
        traj.pos + truss.q
    with pytest.raises(
        WiringError, match=r"cannot compute with .*'traj.pos'.*'multiply' of shapes \(3,\) and \("
    ):
        traj.pos * truss.q
    assert list(diagram.blocks) == ["truss", "traj", "user", "alloc"]
    assert not diagram.wires
    alloc.f >> user.u
    assert issubclass(WiringError, DiagramError)


def test_vectors_can_be_unpacked_and_scalars_cannot():
    _, truss, reference, user, _ = build()
    x, y, z = reference.pos
    assert [port.full_path for port in (x, y, z)] == [f"traj.pos[{i}]" for i in range(3)]
    assert [port.shape for port in user.grid] == [(3,), (3,)]
    with pytest.raises(WiringError, match=r"index \[0\] does not fit 'truss\.energy'"):
        list(truss.energy)
    with pytest.raises(WiringError, match=r"'truss\.f' is already a slice"):
        list(truss.f[:1])
