"""Fixtures of the tests of the compiler and its cache."""

import pytest
from systems import Oscillator, series

from trussflow.blocks import simulate
from trussflow.blocks.support import call_site, temporary_folders
from trussflow.blocks.tracing.compiler import find_compiler, identity


def forget():
    """Set this process to the state before its first compilation."""
    find_compiler.cache_clear()
    identity.cache_clear()
    call_site._said.clear()
    for file in temporary_folders.process_folder().glob("*.s*"):
        file.unlink()


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Return the folder of an empty compile cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("TRUSSFLOW_CACHE", str(folder))
    forget()
    yield folder
    forget()


@pytest.fixture
def run():
    """Return a function that runs ten steps of an oscillator on a backend."""

    def run_on(backend="auto"):
        diagram = series(spring=Oscillator())
        diagram.ground(diagram.spring.u)
        return simulate(diagram, 1.0, step=0.1, backend=backend)

    return run_on
