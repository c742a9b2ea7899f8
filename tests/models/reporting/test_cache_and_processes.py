"""Finished runs are reused, damaged ones made again, and one failure leaves the others alone."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from study_tools import cache
from study_tools.cache import Work, inputs_of, perform
from study_tools.parallel import Failed, perform_all

import trussflow.models
from trussflow.blocks import Constant, Diagram, Integrator, Simulator
from trussflow.models import ModelError


@dataclass(frozen=True)
class Doubling:
    """Doubles a number, or refuses to, or takes the whole process down."""

    name: str
    number: float = 1.0
    fault: str = ""
    method: str = "doubling"

    def work(self, folder):
        """Count how often the result was really computed, in a file."""

        def compute():
            with (folder / "computed.txt").open("a") as file:
                file.write(self.name + "\n")
            if self.fault == "model":
                raise ModelError("numbers above ten cannot be doubled")
            if self.fault == "bug":
                raise ZeroDivisionError("a mistake")
            if self.fault == "killed":
                os._exit(1)
            if self.fault == "slow":
                time.sleep(600)
            return xr.Dataset({"double": ("time", np.array([2 * self.number]))})

        return Work((self.method, str(self.number)), compute)


def computed(folder):
    """Return the names of the jobs that were computed, in order."""
    file = folder / "computed.txt"
    return file.read_text().split() if file.exists() else []


def value(finished):
    """Return what a job found."""
    with xr.open_dataset(finished.file) as data:
        return float(data["double"].values[0])


def test_a_finished_run_is_reused(tmp_path):
    first, second = (perform(Doubling("a", 3.0), tmp_path) for _ in range(2))
    assert (first.reused, second.reused) == (False, True)
    assert value(second) == 6.0
    assert computed(tmp_path) == ["a"]


@pytest.mark.parametrize("other", [Doubling("a", 4.0), Doubling("a", 3.0, method="new")])
def test_another_input_is_another_run(tmp_path, other):
    first, second = perform(Doubling("a", 3.0), tmp_path), perform(other, tmp_path)
    assert not second.reused
    assert first.file != second.file


def test_a_run_is_made_ready_anew_only_after_a_change_of_code(tmp_path, monkeypatch):
    """Nothing is prepared while the code is the same; after a change what it computes decides."""
    perform(Doubling("a", 3.0), tmp_path)
    ready = []
    work = Doubling.work

    def counted(job, folder):
        ready.append(job.name)
        return work(job, folder)

    monkeypatch.setattr(Doubling, "work", counted)
    assert perform(Doubling("a", 3.0), tmp_path).reused
    assert ready == []
    monkeypatch.setattr(cache, "code_digest", lambda: "other code")
    assert perform(Doubling("a", 3.0), tmp_path).reused
    assert ready == ["a"]
    assert computed(tmp_path) == ["a"]


def test_the_digest_of_the_code_is_that_of_its_texts_on_every_machine(tmp_path, monkeypatch):
    """Line ends and files that decide nothing do not matter; text, name and place do."""

    def digest(files):
        root = Path(tempfile.mkdtemp(dir=tmp_path))
        for name, content in files.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_bytes(content)
        monkeypatch.setattr(trussflow.models, "__path__", [str(root)])
        return cache.code_digest.__wrapped__()

    plain = digest({"room/a.py": b"x = 1\ny = 2\n", "b.toml": b"c = 3"})
    same = digest(
        {"b.toml": b"c = 3", "room/a.py": b"x = 1\r\ny = 2\r\n", "README.md": b"new", "a.pyc": b"0"}
    )
    assert same == plain
    others = (
        {"room/a.py": b"x = 1\ny = 3\n", "b.toml": b"c = 3"},
        {"a.py": b"x = 1\ny = 2\n", "b.toml": b"c = 3"},
        {"room/a.py": b"x = 1\ny = 2\n"},
    )
    assert len({plain, *(digest(files) for files in others)}) == 1 + len(others)


@pytest.mark.parametrize("damage", ["cut", "changed", "no hash"])
def test_a_damaged_run_is_made_again(tmp_path, damage):
    file = perform(Doubling("a", 3.0), tmp_path).file
    content = file.read_bytes()
    if damage == "cut":
        file.write_bytes(content[: len(content) // 2])
    elif damage == "changed":
        file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    else:
        file.with_suffix(".sha256").unlink()
    again = perform(Doubling("a", 3.0), tmp_path)
    assert not again.reused
    assert value(again) == 6.0


def test_nothing_half_written_stays(tmp_path):
    perform(Doubling("a"), tmp_path)
    with pytest.raises(ModelError, match="cannot be doubled"):
        perform(Doubling("b", 11.0, fault="model"), tmp_path)
    assert not list(tmp_path.glob(".*"))
    assert len(list(tmp_path.glob("*.nc"))) == 1


@pytest.mark.parametrize(
    ("fault", "reason"),
    [("model", "numbers above ten cannot be doubled"), ("bug", "ZeroDivisionError: a mistake")],
)
def test_a_failing_run_is_named_and_the_others_go_on(tmp_path, fault, reason):
    jobs = [Doubling("good", 1.0), Doubling("bad", 11.0, fault=fault), Doubling("last", 2.0)]
    good, bad, last = perform_all(jobs, tmp_path, workers=1, progress=False)
    assert bad == Failed("bad", reason)
    assert (value(good), value(last)) == (2.0, 4.0)


def test_a_process_that_dies_is_no_hang(tmp_path):
    jobs = [Doubling("good"), Doubling("dead", 5.0, fault="killed")]
    good, dead = perform_all(jobs, tmp_path, workers=1, progress=False)
    assert value(good) == 2.0
    assert "BrokenProcessPool" in str(dead)


def test_interrupt_stops_all_processes(tmp_path):
    """SIGINT to the parent alone, as from another terminal; the finished run is kept."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\nfrom pathlib import Path\n"
        f"sys.path[:0] = {[str(Path(__file__).parent), *(p for p in sys.path if 'studies' in p)]!r}\n"
        "from test_cache_and_processes import Doubling\n"
        "from study_tools.parallel import perform_all\n"
        "if __name__ == '__main__':\n"
        "    jobs = [Doubling('good'), Doubling('slow', 2.0, fault='slow')]\n"
        "    perform_all(jobs, Path(sys.argv[1]), workers=1, progress=False)\n"
    )
    folder = tmp_path / "runs"
    process = subprocess.Popen([sys.executable, str(script), str(folder)], stderr=subprocess.PIPE, text=True)
    while "slow" not in computed(folder):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode != 0
    assert "KeyboardInterrupt" in error
    assert len(list(folder.glob("*.nc"))) == 1


def inputs(duration=1.0, initial=0.0, slope=1.0, **settings):
    """Return the inputs of an integrator that runs up a ramp."""
    diagram = Diagram("ramp")
    ramp, position = diagram.add(slope=Constant([slope]), position=Integrator(shape=1))
    ramp >> position.u
    chosen = {"step": 0.1, "solver": "rk4", "log": ["position.y"], **settings}
    return inputs_of(Simulator(diagram, **chosen), duration, {"position.integral": np.array([initial])})


def test_inputs_change_with_whatever_changes_the_result():
    assert inputs() == inputs()
    changes: tuple[dict[str, Any], ...] = (
        {"duration": 2.0},
        {"initial": 1.0},
        {"slope": 2.0},
        {"step": 0.2},
        {"solver": "euler"},
        {"solver": "LSODA"},
        {"log": ["slope.y"]},
        {"log_step": 0.5},
    )
    assert len({inputs(), *(inputs(**change) for change in changes)}) == 1 + len(changes)
