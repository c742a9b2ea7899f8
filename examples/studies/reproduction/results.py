"""Finished mission runs, by name."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import xarray as xr
from study_tools.cache import Finished

from reproduction.runs import MissionRun
from trussflow.models.errors import ModelError
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.results import check_run


class Results(Mapping[str, "xr.Dataset"]):
    """The results of mission runs, read when first asked for.

    Parameters
    ----------
    runs : sequence of MissionRun
        What was run.
    finished : sequence of Finished
        Where the results are; further ones do not matter.
    folder : pathlib.Path
        Where computed modes are kept.
    """

    def __init__(self, runs: Sequence[MissionRun], finished: Sequence[Finished], folder: Path) -> None:
        self._runs = {run.name: run for run in runs}
        self._files = {f.name: f.file for f in finished if f.name in self._runs}
        self.folder = folder
        self._read = functools.cache(self._checked)

    def __getitem__(self, name: str) -> xr.Dataset:
        if name not in self._files:
            raise ModelError(f"no finished run '{name}'; there are: {', '.join(self._files)}")
        return self._read(name)

    def __contains__(self, name: object) -> bool:
        return name in self._files

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)

    def run(self, name: str) -> MissionRun:
        """Return what was run."""
        return self._runs[name]

    def mission(self, name: str) -> Mission:
        """Return the mission of a run."""
        return self.run(name).mission()

    def file(self, name: str) -> Path:
        """Return the file of a finished run."""
        return self._files[name]

    def is_whole(self, name: str) -> bool:
        """Tell whether the run lasts to the end of the motion and some time beyond."""
        return bool(self.run(name).duration >= 1.2 * self.mission(name).duration)

    def _checked(self, name: str) -> xr.Dataset:
        with xr.open_dataset(self._files[name], decode_cf=False) as raw:
            result = raw.load().astype(float)
        return check_run(result, self._runs[name].space_truss(self.folder))
