"""Diagrams that change while they are built: cut wires, removed and replaced blocks, cells run again."""

import contextlib
import random
import warnings

import numpy as np
import pytest
from systems import series

from trussflow.blocks import Constant, Diagram, Gain, Integrator, simulate
from trussflow.blocks.errors import NameLookupError, OpenInputError, WiringError


def last(diagram, name):
    result = simulate(diagram, 1.0, step=0.5, backend="interpreted")
    return result[name][-1].values.round(12).tolist()


def test_a_cell_is_run_again():
    d = Diagram("d")
    for level in (1.0, 2.0):
        step, gain, integral = d.add(
            step=Constant(level), gain=Gain(3.0), integral=Integrator()
        )
        (2.0 * step - 0.5 * integral) >> gain >> integral
        d.expose(y=integral.y)
        box = series(inner=Gain(level))
        d.add("box", box)
        box.expose(u=box.inner.u, v=box.inner.y)
        integral >> box.u
        d.ground(d.add("spare", Gain(1.0)).u)
        found = last(d, "integral.y")
    fresh = Diagram("d")
    step, gain, integral = fresh.add(
        step=Constant(2.0), gain=Gain(3.0), integral=Integrator()
    )
    (2.0 * step - 0.5 * integral) >> gain >> integral
    assert found == last(fresh, "integral.y")
    assert d.box.u.block is box
    assert d.y.full_path == "d.y"


def test_a_replaced_block_keeps_its_wires():
    d = Diagram("d")
    one, two, gain = d.add(one=Constant(1.0), two=Constant(2.0), gain=Gain(1.0))
    one >> gain
    gain = d.add("gain", Gain(5.0))
    assert last(d, "gain.y") == 5.0
    with pytest.raises(WiringError, match=r"twice(.|\n)*already driven by 'one\.y'"):
        two >> gain
    d.disconnect(gain.u)
    two >> gain
    assert last(d, "gain.y") == 10.0


def test_shapes_are_inferred_anew():
    """Shapes fixed by a replaced source do not stay in the blocks behind it."""
    d = Diagram("d")
    source, gain = d.add(source=Constant(1.0), gain=Gain(2.0))
    source >> gain >> d.add("integral", Integrator())
    assert last(d, "integral.y") == 2.0
    d.add("source", Constant([1.0, 2.0]))
    assert last(d, "integral.y") == [2.0, 4.0]
    d.integral.y[0] >> d.add("first", Gain(1.0))
    d.add("gain", Gain(5.0))
    assert last(d, "first.y") == 5.0
    with pytest.warns(
        RuntimeWarning,
        match=r"is removed: cannot index 'integral\.y': its shape is not known",
    ):
        d.disconnect(d.gain.u)
    d.add("source", Constant(3.0)) >> d.gain
    d.ground(d.first.u)
    assert last(d, "integral.y") == 15.0


def test_wires_that_do_not_fit_any_more_are_cut_and_told():
    d = series(source=Constant([1.0, 2.0]), integral=Integrator([0.0, 0.0]))
    with pytest.warns(
        RuntimeWarning, match=r"is removed: cannot wire 'source\.y' \(shape \(3,\)\)"
    ):
        d.add("source", Constant([1.0, 2.0, 3.0]))
    with pytest.raises(OpenInputError, match=r"'integral\.u'"):
        last(d, "integral.y")


def test_disconnect_and_remove():
    d = Diagram("d")
    source, both = d.add(source=Constant([1.0, 2.0]), both=Gain([1.0, 1.0]))
    source.y[0] >> both.u[1]
    source.y[1] >> both.u[0]
    d.disconnect(both.u[0])
    with pytest.raises(OpenInputError, match=r"'both.u' \(shape \(2,\)\): elements 0"):
        last(d, "both.y")
    d.disconnect(source.y)
    assert not d.wires
    d.disconnect(source.y)
    source >> both
    d.expose(y=both.y)
    outer = Diagram("outer")
    outer.add(d=d, last=Gain(1.0))
    outer.d.y >> outer.last
    outer.expose(z=outer.d.y)
    d.remove("both")
    assert not outer.wires
    assert not outer.exposed
    assert both.parent is None
    outer.add("both", both)
    d.remove(source)
    assert not d.blocks
    for nothing in ("both", source, 3, ["both"]):
        with pytest.raises(
            NameLookupError, match=r"cannot remove .* from 'd': there is nothing"
        ):
            d.remove(nothing)
    for port in (source.y, both.y, 3):
        with pytest.raises(
            WiringError, match=r"cannot disconnect .* no port of a block in diagram 'd'"
        ):
            d.disconnect(port)


def test_exposed_ports_are_carried_over():
    outer, inner = Diagram("outer"), Diagram("inner")
    inner.add(first=Gain(2.0), second=Gain(3.0))
    inner.expose(u=(inner.first.u, inner.second.u), y=inner.first.y)
    outer.add(inner=inner, source=Constant([1.0, 1.0]))
    outer.source >> inner.u
    inner.add("first", Gain([5.0, 7.0]))
    assert last(outer, "inner.first.y") == [5.0, 7.0]
    inner.remove("second")
    assert last(outer, "inner.first.y") == [5.0, 7.0]
    inner.remove("y")
    assert "y" not in inner.ports


def test_completion_knows_blocks_and_ports():
    d = Diagram("d")
    gain = d.add("gain", Gain(1.0))
    assert "gain" in dir(d)
    assert {"u", "y"} <= set(dir(gain))
    d.expose(out=gain.y)
    assert "out" in dir(d)


@pytest.mark.parametrize("seed", range(10))
def test_random_changes_end_where_a_fresh_diagram_begins(seed):
    """The diagram at the end alone counts, not the changes before."""
    random_, d = random.Random(seed), Diagram("d")
    names = ["a", "b", "c", "e"]
    kinds = {}
    for _ in range(30):
        name = random_.choice(names)
        kinds[name] = (
            random_.choice(["source", "gain", "lag"]),
            random_.uniform(1.0, 2.0),
            random_.choice([0, 2]),
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            d.add(name, build(*kinds[name]))
            if random_.random() < 0.3 and len(kinds) > 2:
                gone = random_.choice([*kinds])
                d.remove(gone)
                del kinds[gone]
            ends = random_.choices([*kinds], k=2)
            with contextlib.suppress(WiringError, NameLookupError):
                d.blocks[ends[0]].only_output() >> d.blocks[ends[1]]
            if random_.random() < 0.2:
                d.disconnect(*d.blocks[random_.choice([*kinds])].outputs())
    fresh = Diagram("d")
    for name, block in d.blocks.items():
        fresh.add(name, build(*kinds[name]))
        assert block.parent is d
    for wire in d.wires:
        fresh.connect(
            fresh.blocks[wire.source.block.name].y,
            fresh.blocks[wire.target.block.name].u,
        )
    for one in (d, fresh):
        one.ground(
            *(
                b.u
                for b in one.blocks.values()
                if b.inputs() and not [w for w in one.wires if w.target.block is b]
            )
        )
    shapes = [[block.y.shape for block in one.blocks.values()] for one in (d, fresh)]
    assert shapes[0] == shapes[1]


def build(kind, value, size):
    numbers = np.full(size, value) if size else value
    if kind == "source":
        return Constant(numbers)
    return Gain(numbers if size else value) if kind == "gain" else Integrator(numbers)
