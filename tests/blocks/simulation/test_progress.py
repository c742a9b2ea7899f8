"""The progress bar: only in long runs, with the real-time factor."""

import re

import pytest

from trussflow.blocks.simulation.progress import ProgressBar


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
    with ProgressBar("mission", 80.0, shown) as bar:
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
    ("whole", "said"), [(5e-7, "2.5e-07/5e-07 s, 1.25e-07 x"), (4e10, "2e+10/4e+10 s, 1e+10 x")]
)
def test_times_of_any_size_are_told(clock, capsys, whole, said):
    """Radars run for nanoseconds, reactions for thousands of years."""
    with ProgressBar("mission", whole, True) as bar:
        clock.now += 2.0
        bar.update(whole / 2)
    assert said in capsys.readouterr().err


def test_it_can_be_switched_off(clock, capsys):
    assert run(clock, capsys, 2.0, shown=False) == ""


def test_round_off_does_not_overfill_the_bar(clock, capsys):
    """A sum of steps may end a little beyond the duration; tqdm would warn of that."""
    with ProgressBar("mission", 0.3, True) as bar:
        for _ in range(3):
            clock.now += 2.0
            bar.update(0.1 + 1e-12)
    assert "100 %" in capsys.readouterr().err
