"""Sessions and runs with FMUs go on from files bit for bit, if the FMU can write its state down."""

import itertools

import pytest
import xarray as xr

from trussflow.blocks import Diagram, Session, Simulator
from trussflow.blocks.errors import SimulationError, SimulationInterrupted
from trussflow.blocks.results.streamed_log import StreamedLog
from trussflow.fmu import Fmu

TIME_STEP = 0.01


def bouncing(path, kind, **options):
    diagram = Diagram("bouncing")
    step = {"step": 0.05} if kind == "cs" else {}
    ball = diagram.add(ball=Fmu(path, kind=kind, **step, **options))
    diagram.expose(height=ball.port("h"))
    return diagram


@pytest.mark.parametrize(
    "kind, version, options",
    [
        ("cs", 2, {}),
        ("me", 3, {}),
        ("cs", 3, {"time_limit": 30.0}),
        ("me", 2, {"time_limit": 30.0}),
    ],
)
def test_another_session_goes_on_bit_for_bit(
    make_fmu, kind, version, options, tmp_path
):
    diagram = bouncing(make_fmu("ball", version), kind, **options)
    one, other = (Session(diagram, step=TIME_STEP) for _ in "ab")
    with one, other:
        one.advance(0.73)
        one.save(tmp_path / "ball.state")
        other.restore(tmp_path / "ball.state")
        heights = [[], []]
        for k in range(1, 15):
            for session, found in zip((one, other), heights, strict=True):
                session.advance(0.73 + 0.1 * k)
                found.append(float(session.outputs["height"]))
        assert heights[0] == heights[1]
        assert max(heights[0]) > min(heights[0]) + 0.05


def test_a_run_is_resumed_bit_for_bit(make_fmu, kind, tmp_path, monkeypatch):
    running = Simulator(bouncing(make_fmu("ball", 2), kind), step=TIME_STEP)

    def result(name):
        path = tmp_path / f"{name}.nc"
        given = {"checkpoint_every": 0.25, "resume": True, "progress": False}
        with running.run(2.0, stream_to=path, **given) as found:
            return found.load()

    original, number = StreamedLog.checkpoint, itertools.count()

    def checkpoint(own, *arguments):
        original(own, *arguments)
        if next(number) == 3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(StreamedLog, "checkpoint", checkpoint)
        with pytest.raises(SimulationInterrupted):
            result("stopped")
    xr.testing.assert_equal(result("stopped"), result("whole"))


def test_fmus_that_cannot_be_written_down_say_why(make_fmu, kind, tmp_path):
    """In one process they go back all the same, if they can do that."""
    held = make_fmu("ball", 2, replace={'canSerializeFMUstate="true"': ""})
    message = r"block 'ball' keeps a state of FMU 'ball', which cannot serialize it to bytes \(no canSerialize"
    with Session(bouncing(held, kind), step=TIME_STEP) as session:
        session.advance(0.3)
        with pytest.raises(
            SimulationError, match=rf"cannot save to '.*a\.state': {message}"
        ):
            session.save(tmp_path / "a.state")
        session.restore(session.save())
    with pytest.raises(SimulationError, match=message):  # before anything is computed
        Simulator(bouncing(held, kind), step=TIME_STEP).run(
            1e9, stream_to=tmp_path / "a.nc", checkpoint_every=1.0
        )
    flags = 'canGetAndSetFMUstate="true" canSerializeFMUstate="true"'
    stuck = make_fmu("ball", 2, replace={flags: ""})
    with Session(bouncing(stuck, kind), step=TIME_STEP) as session:
        session.advance(0.3)
        why = r"cannot save: block 'ball' .*; its FMU cannot save its state \(no canGetAndSet"
        with pytest.raises(SimulationError, match=why):
            session.save(tmp_path / "a.state")
    assert not (tmp_path / "a.state").exists()
