"""Shapes, units and frames that ports take over from what they are wired to."""

import itertools

import numpy as np
import pytest
from systems import here, series

from trussflow.blocks import UnitDelay
from trussflow.blocks.errors import WiringError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.simulation.simulator import simulate


class Pass(Block):
    u = Input(INFERRED, unit=INFERRED, frame=INFERRED)
    y = Output(INFERRED, unit=INFERRED, frame=INFERRED)

    def output(self, t, x, u, p):
        return {"y": u.u}


class Forces(Block):
    f = Output((2, 3), unit="N", frame="body")
    mixed = Output((3,), unit=("m", "rad", "N"))

    def output(self, t, x, u, p):
        numbers = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
        return {"f": t + numbers, "mixed": t + numbers[0]}


class Sink(Block):
    n = Input((2, 3), unit="N", frame="body")
    m = Input((2, 3), unit="m")
    k = Input((4,), unit="N")
    w = Input((2, 3), unit="N", frame="world")


def chain(length):
    diagram = Diagram("chain")
    blocks = [diagram.add(f"p{i}", Pass()) for i in range(length)]
    for first, second in itertools.pairwise(blocks):
        first >> second
    return diagram, blocks


def test_inference_runs_through_a_chain_and_fans_out():
    diagram, blocks = chain(4)
    others = diagram.add(left=Pass(), right=Pass())
    for other in others:
        blocks[1] >> other
    assert blocks[3].y.shape is None
    forces = diagram.add(forces=Forces())
    forces.f >> blocks[0]
    for block in (*blocks, *others):
        assert (block.y.shape, block.y.unit, block.y.frame) == ((2, 3), "N", "body")


def test_inference_runs_backwards_too():
    """The last input fixes the shape of everything before it; then the wrong source is refused."""
    diagram, blocks = chain(3)
    sink = diagram.add(sink=Sink())
    where = here(1)
    blocks[2].y >> sink.k
    assert blocks[0].u.shape == (4,)
    forces = diagram.add(forces=Forces())
    with pytest.raises(
        WiringError, match=r"shape \(2, 3\) does not fit \(4,\)"
    ) as error:
        forces.f >> blocks[0].u
    assert f"p0.u has its shape from {where}" in str(error.value)


@pytest.mark.parametrize("name, what", [("k", "shape"), ("m", "unit"), ("w", "frame")])
def test_conflict_names_the_wire_and_the_line_that_fixed_it(name, what):
    diagram, blocks = chain(2)
    forces, sink, other = diagram.add(forces=Forces(), sink=Sink(), other=Pass())
    forces.f >> other
    fixed = here(1)
    forces.f >> blocks[0]
    wire = here(2)
    with pytest.raises(WiringError) as error:
        blocks[1].y >> sink.port(name)
    text = str(error.value)
    assert text.splitlines()[0].endswith(f"[{wire}]")
    assert f"p1.y has its {what} from {fixed}" in text


def test_wire_that_fails_infers_nothing():
    diagram, blocks = chain(1)
    forces, sink = diagram.add(forces=Forces(), sink=Sink())
    forces.f >> sink.n
    with pytest.raises(WiringError, match="twice"):
        blocks[0].y >> sink.n
    assert blocks[0].y.shape is None


def test_slices_give_shape_and_unit():
    diagram, blocks = chain(2)
    forces, other = diagram.add(forces=Forces(), other=Pass())
    forces.f[0] >> blocks[0]
    assert (blocks[1].y.shape, blocks[1].y.unit) == ((3,), "N")
    forces.mixed[1:] >> other
    assert (other.y.shape, other.y.unit) == ((2,), ("rad", "N"))


def test_ring_without_a_known_shape_is_scalar():
    """A ring without a known shape is scalar, and later wires must fit."""
    diagram, blocks = chain(2)
    blocks[1] >> blocks[0]
    flatten(diagram)
    assert blocks[0].y.shape == blocks[1].u.shape == ()
    forces = diagram.add(forces=Forces())
    third = diagram.add(third=Pass())
    blocks[0] >> third
    with pytest.raises(
        WiringError, match=r"shape \(2, 3\) does not fit \(\)|cannot drive"
    ):
        forces.f >> third


def test_units_must_be_as_many_as_elements():
    class Two(Block):
        u = Input((2,), unit=("m", "rad", "N"))

    diagram = Diagram("wrong")
    forces, two = diagram.add(forces=Forces(), two=Two())
    with pytest.raises(WiringError, match=r"'two\.u' has 3 units for 2 elements"):
        forces.mixed[:2] >> two.u


@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
def test_states_take_the_inferred_shape(backend):
    diagram = series(forces=Forces())
    diagram.forces.f >> diagram.add(memory=UnitDelay(1.0, 2.0))
    result = simulate(diagram, 0.1, step=0.1, backend=backend)
    assert result["memory.y"].shape == (2, 2, 3)
    assert (result["memory.y"] == 2.0).all()
    assert result["memory.y"].attrs["units"] == "N"


def test_long_chains_are_no_problem():
    """Inference and evaluation do not recurse once per block."""
    diagram, blocks = chain(500)
    forces = diagram.add(forces=Forces())
    forces.f >> blocks[0]
    result = simulate(diagram, 0.1, step=0.1, backend="interpreted", log=[blocks[-1].y])
    assert result["p499.y"][0, 1, 2] == 6.0
