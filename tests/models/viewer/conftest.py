"""Runs to look at, made of sines, and the browser that looks at them."""

from contextlib import contextmanager

import numpy as np
import pytest
import xarray as xr
from browsing import Watched

from trussflow.blocks.results.dataset import save
from trussflow.models import SpaceTruss
from trussflow.models.viewer import replay


def run_of(truss, *, duration=8.0, step=0.02, phase=0.0, modal=0.3):
    """Return a run in which everything moves: metres, radians, and deformations of centimetres."""
    time = np.arange(0.0, duration + step / 2, step)

    def waves(size, amplitude, seed):
        rng = np.random.default_rng(seed)
        rate, start = rng.uniform(0.5, 1.5, size), rng.uniform(0.0, 6.0, size)
        return amplitude * np.sin(np.outer(time, rate) + start + phase)

    def pushes(amplitude, seed, unit):
        values = waves(3 * truss.robots, amplitude, seed).reshape(-1, truss.robots, 3)
        return ("time", "robot", "axis"), values, {"units": unit}

    moved = [
        waves(3, 4.0, 1),
        waves(truss.rigid_q - 3, 0.8, 2),
        waves(truss.modes, modal, 3),
    ]
    return xr.Dataset(
        {
            "truss.coordinates": (("time", "coordinate"), np.hstack(moved)),
            "truss.base_force": pushes(5.0, 4, "N"),
            "truss.base_torque": pushes(1.0, 5, "N*m"),
            "law.error": (
                ("time", "task"),
                waves(truss.rigid, 1e-3, 6),
                {"units": "m, rad"},
            ),
            "truss.energy": ("time", 1.0 + np.ravel(waves(1, 1.0, 7)), {"units": "J"}),
        },
        {
            "time": ("time", time, {"units": "s"}),
            "axis": list("xyz"),
            "robot": range(1, truss.robots + 1),
        },
        {"target": np.linspace(-2.0, 2.0, truss.rigid_q)},
    )


@pytest.fixture(scope="session")
def make_run():
    return run_of


@pytest.fixture(scope="session")
def truss():
    return SpaceTruss.consistent()


@pytest.fixture(scope="session")
def run(truss):
    return run_of(truss)


@pytest.fixture(scope="session")
def page_file(truss, run, tmp_path_factory):
    """Return a page of `run`, written from its file."""
    folder = tmp_path_factory.mktemp("page")
    save(run, folder / "run.nc")
    return replay(folder / "run.nc", truss, folder / "replay.html", title="A run")


class Replay(Watched):
    """A page of a run."""

    def open(self, file, **asked):
        """Load a file with settings; return its page."""
        words = "&".join(f"{key}={value}" for key, value in asked.items())
        self.load(f"{file.as_uri()}#{words}")
        return self.page


@contextmanager
def windows(chromium):
    """Yield a function that opens windows, small ones as pixels take most of the time; close them in the end."""
    made = []

    def make(width=640, height=480):
        context = chromium.new_context(viewport={"width": width, "height": height})
        made.append(Replay(context.new_page(), "error"))
        return made[-1]

    yield make
    for one in made:
        one.page.context.close()
        assert one.complaints == []


@pytest.fixture
def opened(chromium):
    """Return a maker of windows."""
    with windows(chromium) as make:
        yield make


@pytest.fixture(scope="module")
def window(chromium, page_file):
    """Return a window with the page of `run`; tests may do with it what its controls do."""
    with windows(chromium) as make:
        found = make()
        found.open(page_file)
        yield found
