"""Finished runs, kept on disk by a hash of everything that goes into them."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

import xarray as xr

import trussflow.blocks
import trussflow.models
from trussflow.blocks.framework.files import replaced
from trussflow.blocks.simulation.simulator import Simulator

SOURCES = (".py", ".c", ".h", ".toml", ".json")
"""Endings of the files that decide what a run does."""

LIBRARIES = ("casadi", "numpy", "scipy")
"""Libraries that compute a part of it."""


@dataclass(frozen=True, slots=True)
class Work:
    """A run made ready: what determines its result, and how to get it.

    Attributes
    ----------
    inputs : tuple of str
        Everything that determines the result: traced equations, parameters, settings.
    compute : callable
        Returns the result.
    """

    inputs: tuple[str, ...]
    compute: Callable[[], xr.Dataset]


class Job(Protocol):
    """Something that can be run by itself, in another process, and kept."""

    @property
    def name(self) -> str:
        """Its name, unique in the report."""

    def work(self, folder: Path) -> Work:
        """Make it ready; `folder` is where shared data are kept."""


@dataclass(frozen=True, slots=True)
class Finished:
    """A run that is there.

    Attributes
    ----------
    name : str
        Of the job.
    file : pathlib.Path
        Its result.
    reused : bool
        Whether it was there before.
    """

    name: str
    file: Path
    reused: bool


def inputs_of(simulator: Simulator, duration: float, initial: Mapping[str, Any]) -> tuple[str, ...]:
    """Return everything that determines the result of a run.

    Parameters
    ----------
    simulator : Simulator
        The diagram, traced, with solver and steps.
    duration : float
        Simulated time [s].
    initial : mapping
        Initial values of states that are not the blocks' own.
    """
    prepared = simulator.prepared
    plan = prepared.plan
    p = plan.parameters({})
    x, d = plan.initial(p, initial)
    settings = {
        "parameters": plan.p.listed(p),
        "initial": plan.x.listed(x) | plan.memory.listed(d),
        "solver": str(prepared.solver),
        "duration": duration,
        "log": ([c.name for c in prepared.channels], str(simulator.log_step)),
        "backend": prepared.traced.name,
        "versions": {name: version(name) for name in ("casadi", "numpy", "scipy")},
    }
    # The fingerprint covers the equations of motion, the programs also what is logged.
    codes = (program.code for program in prepared.programs)
    return prepared.fingerprint, *codes, json.dumps(settings, sort_keys=True)


def perform(job: Job, folder: Path) -> Finished:
    """Return the finished run of a job, computing it unless it is there already.

    A result is one netCDF file, with the hash of its bytes beside it. Both are moved into
    place in one piece, the hash last; a file that does not match its hash is computed again.

    Parameters
    ----------
    job : Job
        What to run.
    folder : pathlib.Path
        Where finished runs are kept.
    """
    # Making a job ready takes seconds; while no line of code has changed, its own values will do.
    shortcut = folder / f"{digest_of((code_digest(), repr(libraries()), repr(job)))}.key"
    with contextlib.suppress(OSError):
        known = folder / f"{shortcut.read_text(encoding='ascii')}.nc"
        if is_intact(known):
            return Finished(job.name, known, reused=True)
    work = job.work(folder)
    key = digest_of(work.inputs)
    file = folder / f"{key}.nc"
    if is_intact(file):
        write_atomically(shortcut, key)
        return Finished(job.name, file, reused=True)
    result = work.compute()
    # Four bytes a number are enough to read off a result; half the space, and less when packed.
    packing = {str(name): {"dtype": "f4", "zlib": True, "complevel": 1} for name in result}
    with replaced(file) as partial:
        result.to_netcdf(partial, engine="netcdf4", encoding=packing)
        digest = _digest(partial)
    write_atomically(_digest_file(file), digest)
    write_atomically(shortcut, key)
    return Finished(job.name, file, reused=False)


@functools.cache
def code_digest() -> str:
    """Return a hash of our files, which all runs and the report itself are made by.

    It is the same on every machine: names and texts of the files go in, with ``/`` and line
    feeds whatever the machine has; versions of libraries do not (see `libraries`).
    """
    parts = []
    for package in (trussflow.blocks, trussflow.models):
        root = Path(package.__path__[0])
        files = {f.relative_to(root).as_posix(): f for f in root.rglob("*") if f.suffix in SOURCES}
        parts += [f"{package.__name__} {name} {files[name].read_text('utf-8')}" for name in sorted(files)]
    return digest_of(parts)


def libraries() -> dict[str, str]:
    """Return the versions of the libraries that compute a part of the results."""
    return {name: version(name) for name in LIBRARIES}


def is_intact(file: Path) -> bool:
    """Tell whether a finished run is there and undamaged.

    Parameters
    ----------
    file : pathlib.Path
        The run.
    """
    try:
        return _digest_file(file).read_text(encoding="ascii") == _digest(file)
    except (OSError, UnicodeDecodeError):
        return False


def write_atomically(file: Path, text: str) -> None:
    """Write a text file in one piece: readers see the old one or the new one.

    Parameters
    ----------
    file : pathlib.Path
        Where.
    text : str
        What.
    """
    with replaced(file) as partial:
        partial.write_text(text, encoding="utf-8")


def digest_of(parts: Sequence[str]) -> str:
    """Return a hash of texts.

    Parameters
    ----------
    parts : sequence of str
        Their order matters.
    """
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _digest_file(file: Path) -> Path:
    return file.with_suffix(".sha256")
