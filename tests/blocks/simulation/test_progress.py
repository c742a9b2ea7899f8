"""The progress bar: only in long runs, with the real-time factor."""

import io
import itertools
import re
import subprocess
import sys

import pytest
from systems import decay

from trussflow.blocks import simulate, sweep
from trussflow.blocks.support.progress import RunBar


class Clock:
    """Wall time that we set."""

    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    found = Clock()
    monkeypatch.setattr("tqdm.std.time", found)
    return found


def run(clock, screen, seconds, *, shown=True):
    """Simulate 80 s in eight updates of `seconds` wall time each; return what was printed."""
    with RunBar("mission", 80.0, shown) as bar:
        for _ in range(8):
            clock.now += seconds
            bar.update(10.0)
    return screen.readouterr().err


def test_short_runs_print_nothing(clock, capsys):
    assert run(clock, capsys, 0.1).strip() == ""


def test_long_runs_print_simulated_time_and_real_time_factor(clock, capsys):
    printed = run(clock, capsys, 2.0)
    assert re.search(r"mission  50 %\|.*\| 40/80 s, 5 x real time, 00:08 left", printed)


@pytest.mark.parametrize(
    "whole, said",
    [(5e-7, "2.5e-07/5e-07 s, 1.25e-07 x"), (4e10, "2e+10/4e+10 s, 1e+10 x")],
)
def test_times_of_any_size_are_told(clock, capsys, whole, said):
    """Radars run for nanoseconds, reactions for thousands of years."""
    with RunBar("mission", whole, True) as bar:
        clock.now += 2.0
        bar.update(whole / 2)
    assert said in capsys.readouterr().err


def test_it_can_be_switched_off(clock, capsys):
    assert run(clock, capsys, 2.0, shown=False) == ""


def test_round_off_does_not_overfill_the_bar(clock, capsys):
    """A sum of steps may end a little beyond the duration; tqdm would warn of that."""
    with RunBar("mission", 0.3, True) as bar:
        for _ in range(3):
            clock.now += 2.0
            bar.update(0.1 + 1e-12)
    assert "100 %" in capsys.readouterr().err


def test_round_off_leaves_no_bar_of_a_failed_run():
    """Notebooks show one that is not full; ten times 0.1 is 1 - 1.1e-16."""
    with RunBar("mission", 1.0, True) as bar:
        for _ in range(10):
            bar.update(0.1)
    assert bar.n == 1.0


class Unread(io.StringIO):
    """A pipe that nobody reads."""

    def write(self, text):
        raise BrokenPipeError(32, "Broken pipe")


@pytest.mark.parametrize("stderr", [None, Unread()])
def test_a_display_that_cannot_be_written_ends_nothing(stderr, monkeypatch):
    monkeypatch.setattr("tqdm.std.time", itertools.count(0.0, 2.0).__next__)
    monkeypatch.setattr("sys.stderr", stderr)
    assert simulate(decay(()), 1.0, step=0.1).status == "complete"
    end = sweep(
        decay(()),
        1.0,
        step=0.1,
        vary={"back.gain": [1.0, 2.0]},
        keep={"x.y": "final"},
        workers=1,
    )
    assert [*end.status] == ["complete"] * 2


def test_a_script_with_a_closed_display_ends_well():
    script = """
import itertools, os, tqdm.std, trussflow.blocks as b
loop = b.Diagram("loop")
loop.add(one=b.Constant(1.0))
simulator = b.Simulator(loop, step=0.1)
tqdm.std.time = itertools.count(0.0, 2.0).__next__
os.close(2)
simulator.run(100.0)
"""
    assert subprocess.run([sys.executable, "-c", script]).returncode == 0
