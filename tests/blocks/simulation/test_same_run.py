"""What tells one run from another: only the same run is resumed, and one that is complete is not repeated."""

from fractions import Fraction

import numpy as np
import pytest
from systems import series

from trussflow.blocks import Block, Diagram, Function, Output, Simulator, Sine
from trussflow.blocks.errors import SimulationError, TimeLimitError


def test_runs_of_other_logged_equations_and_other_starts_of_loops_are_not_resumed(
    tmp_path,
):
    def changed(gain, start):
        diagram = Diagram("d", loops="solve")
        sine, logged, loop, back = diagram.add(
            sine=Sine(1.0),
            logged=Function(lambda u: gain * u),
            loop=Function(lambda u: 2.0 * np.tanh(2.0 * u)),
            back=Function(lambda u: u),
        )
        sine >> logged
        loop >> back >> loop
        diagram.guess(loop.y, start)
        diagram.guess(back.y, start)
        return Simulator(diagram, step=0.01, backend="interpreted")

    path = tmp_path / "run.nc"
    settings = {"stream_to": path, "checkpoint_every": 1.0, "resume": True}
    with pytest.raises(TimeLimitError):
        changed(2.0, 2.0).run(1e9, time_limit=0.3, **settings)
    with pytest.raises(
        SimulationError, match=r": logged_hash is '\w+' there, '\w+' here$"
    ):
        changed(3.0, 2.0).run(1e9, **settings)
    with pytest.raises(
        SimulationError, match=r": initial '\w+\.y' is \[2\.0\] there, \[-2\.0\] here"
    ):
        changed(2.0, -2.0).run(1e9, **settings)


def test_a_complete_run_is_returned_as_it_is(tmp_path):
    def run(duration, **others):
        diagram = series(sine=Sine(1.0))
        running = Simulator(diagram, step=0.25, backend="interpreted")
        with running.run(
            duration, stream_to=tmp_path / "a.nc", checkpoint_every=1.0, **others
        ) as result:
            return result.load()

    first = run(2.0)
    again = run(2.0, resume=True)
    assert again.identical(first)  # with the time that it took
    assert [p.name for p in tmp_path.iterdir()] == ["a.nc"]
    for duration, others in (
        (2.0, {}),
        (3.0, {"resume": True}),
        (3.0, {"resume": True, "start": 1.0}),
    ):
        other = run(duration, **others)
        assert other.attrs["wall_time"] != first.attrs["wall_time"]
        assert len(other.time) == 4 * duration + 1
        assert other.time[0] == others.get("start", 0.0)
        first = other
    (tmp_path / "a.nc").write_bytes(b"no result")
    assert len(run(3.0, resume=True).time) == 13


class Listed(Block):
    traced = False
    y = Output()

    def __init__(self, given):
        self.given = given
        super().__init__()

    def output(self, t, x, u, p):
        return {"y": np.asarray(0.0)}


class Slotted(Listed):
    __slots__ = ("given",)


@pytest.mark.parametrize("kind", [Listed, Slotted])
@pytest.mark.parametrize(
    "one, other",
    [
        ((1.0,), (5.0,)),
        ([1, [2]], [1, [3]]),
        ({"a": 1}, {"a": 2}),
        ({"a": 1}, {"b": 1}),
        (Fraction(1, 3), Fraction(2, 3)),
        (np.float32(1.0), np.float32(2.0)),
        (True, False),
        (None, 0),
        (b"a", b"b"),
        (np.array([object(), 1]), np.array([object(), 2])),
    ],
    ids=lambda value: "array" if isinstance(value, np.ndarray) else repr(value),
)
def test_what_python_blocks_were_made_with_tells_them_apart(kind, one, other):
    def mark(given):
        diagram = series(block=kind(given))
        return Simulator(diagram, step=0.1, backend="interpreted").prepared.fingerprint

    assert mark(one) == mark(one) != mark(other)
