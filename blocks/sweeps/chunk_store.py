"""Chunk store of samples, in memory or in a folder.

Each chunk is a netCDF file that is written atomically; many small chunks are merged. So a killed sweep
can be resumed.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.results.dataset import WRITE_ERRORS, cannot_write, save
from trussflow.blocks.results.pieces import locked_folder, pieces_of, read_piece
from trussflow.blocks.support.files import reading, replaced
from trussflow.blocks.support.validation import as_path
from trussflow.blocks.sweeps.samples import Samples

if TYPE_CHECKING:
    import xarray as xr

PIECE_SECONDS = 1.0
"""Wall time after which samples are written, even if they are few [s]."""

PIECE_BYTES = 4_000_000
"""Size of the samples in memory at which they are written, and upper limit of a small chunk [B]."""

SMALL_PIECES = 100
"""Number of small chunks that are merged."""


class Pieces:
    """Finished samples of one sweep.

    Parameters
    ----------
    path : path or None
        The folder; None to store samples in memory.
    identity : mapping
        Data that determine the samples of this sweep.
    count : int
        Number of samples [-].

    Attributes
    ----------
    finished, failed : array of bool
        Whether each sample is finished, and whether it failed.

    Raises
    ------
    SimulationError
        If the folder contains another sweep, or cannot be read or written.
    """

    def __init__(
        self, path: str | Path | None, identity: Mapping[str, Any], count: int
    ) -> None:
        self.path = path
        self._lock: IO[str] | None = None
        self._waiting: list[Samples] = []
        self._bytes, self._written = 0, time.monotonic()
        self._parts: list[xr.Dataset] = []
        self.finished, self.failed = np.zeros(count, bool), np.zeros(count, bool)
        if path is not None:
            self.path = as_path(SimulationError, "cannot keep the sweep in", path)
            try:
                # Through JSON, so that it equals the identity that was read from a
                # file: tuples are lists.
                self._open(self.path, json.loads(json.dumps(identity)))
            except BaseException:
                self.close()
                raise

    def _open(self, folder: Path, identity: Mapping[str, Any]) -> None:
        """Lock a folder, compare its sweep with this one, and read the finished samples."""
        file = folder / "sweep.json"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not file.exists() and any(
                f.name != "lock" for f in folder.glob("[!.]*")
            ):
                raise SimulationError(
                    f"'{folder}' is no folder of a sweep, and not empty; give another path"
                )
            # Before sweep.json is written: of two sweeps that start at
            # once, only one goes on.
            self._lock = locked_folder(folder, "sweep")
            if not file.exists():
                with replaced(file) as partial:
                    partial.write_text(json.dumps(identity, indent=1), encoding="utf-8")
            with reading(
                file,
                SimulationError,
                "cannot continue the sweep of",
                "it is damaged ({})",
            ):
                other = dict(json.loads(file.read_text(encoding="utf-8")))
        except WRITE_ERRORS as error:
            raise cannot_write(folder, error) from error
        if differs := [key for key in identity if other.get(key) != identity[key]]:
            raise SimulationError(
                f"'{folder}' holds another sweep: its {', '.join(differs)} differ from those of this sweep; "
                "give another path, or delete the folder"
            )
        names = (int(piece.stem) for piece in self._pieces())
        # After the last number, so that no chunk is ever overwritten.
        self._next = itertools.count(1 + max(names, default=-1))
        for piece in self._pieces():
            found = self._read(piece)
            which = found["sample"].values
            self.finished[which], self.failed[which] = (
                True,
                found["status"] != "complete",
            )

    def add(self, samples: Iterable[Samples]) -> None:
        """Add finished samples.

        Raises
        ------
        SimulationError
            If the name of a result is reserved, or that of a varied value.
        """
        for sample in samples:
            if taken := sorted(
                {*sample.values} & {*sample.varied, "sample", "status", "message"}
            ):
                raise SimulationError(
                    f"'{taken[0]}' cannot be kept by that name, which is varied, or is sample, status or "
                    f"message: give another one, as in keep={{'last': ('{taken[0]}', 'final')}}"
                )
            self._waiting.append(sample)
            self._bytes += sum(value.nbytes for value in sample.values.values())
            # As yet in memory only: after a kill, the resumed sweep
            # runs the sample again.
            self.finished[sample.numbers] = True
            self.failed[sample.numbers] = sample.status != "complete"
        self.write(force=False)

    def write(self, *, force: bool) -> None:
        """Write the samples in memory as a chunk, if they are old or large enough, or by `force`.

        Raises
        ------
        SimulationError
            If it cannot be written.
        """
        due = (
            time.monotonic() - self._written > PIECE_SECONDS
            or self._bytes > PIECE_BYTES
        )
        if not self._waiting or not (force or (due and self.path is not None)):
            return
        piece = _piece(self._waiting)
        if isinstance(self.path, Path):
            self._save(piece)
            small = [p for p in self._pieces() if p.stat().st_size < PIECE_BYTES]
            if len(small) >= SMALL_PIECES:
                # Saved before the small ones are deleted: a kill in between leaves
                # duplicates, which `_joined` removes.
                self._save(_joined(map(self._read, small)))
                for one in small:
                    one.unlink()
        else:
            self._parts.append(piece)
        self._waiting, self._bytes, self._written = [], 0, time.monotonic()

    def whole(self) -> xr.Dataset:
        """Return all samples in their order."""
        self.write(force=True)
        parts = (
            map(self._read, self._pieces())
            if self.path is not None
            else iter(self._parts)
        )
        return _joined(parts)

    def close(self) -> None:
        """Write the samples in memory, if possible, and unlock the folder."""
        with contextlib.suppress(SimulationError):
            self.write(force=True)
        if self._lock is not None:
            self._lock.close()

    def _pieces(self) -> list[Path]:
        return pieces_of(Path(self.path or ""))

    def _save(self, piece: xr.Dataset) -> None:
        try:
            save(piece, Path(self.path or "") / f"{next(self._next):09d}.nc")
        except SimulationError as error:
            left = f"{error}; samples written before are kept there, and the same call continues with the others"
            raise SimulationError(left) from error

    def _read(self, piece: Path) -> xr.Dataset:
        return read_piece(piece, "the same call runs its samples again")


def _piece(samples: Sequence[Samples]) -> xr.Dataset:
    """Return samples as a dataset; missing results are NaN."""
    import xarray as xr

    numbers = np.concatenate([s.numbers for s in samples])
    counts = [len(s.numbers) for s in samples]
    varied = {}
    for name in samples[0].varied:
        values = np.concatenate([s.varied[name] for s in samples])
        varied[name] = (
            ["sample", *(f"{name}_{k}" for k in range(values.ndim - 1))],
            values,
        )
    found = xr.Dataset(coords=varied | {"sample": numbers})
    for name in dict.fromkeys(name for s in samples for name in s.values):
        # A sample that failed has no values, so its entries become NaN.
        there = np.repeat([name in s.values for s in samples], counts)
        each = [s.values[name] for s in samples if name in s.values]
        shape = each[0].shape[1:]
        if all(isinstance(v, np.ndarray) and v.shape[1:] == shape for v in each):
            stacked = np.full((len(numbers), *shape), np.nan)
            stacked[there] = np.concatenate(each)
            axes = [f"{name}_{k}" for k in range(len(shape))]
            found[name] = ["sample", *axes], stacked
            found = found.assign_coords(
                {axis: np.arange(n) for axis, n in zip(axes, shape, strict=True)}
            )
            continue
        # Signals may have different lengths: the outer join fills the
        # shorter ones with NaN.
        arrays = [_with_coordinates(name, value) for values in each for value in values]
        index = xr.DataArray(numbers[there], dims="sample", name="sample")
        whole = xr.concat(
            arrays, index, join="outer", coords="minimal", compat="override"
        )
        found = found.merge(
            whole.reindex(sample=numbers), join="outer", compat="override"
        )
    for key in ("status", "message"):
        words = np.array([getattr(s, key) for s in samples], str)
        found[key] = "sample", np.repeat(words, counts)
    return found


def _with_coordinates(name: str, value: Any) -> xr.DataArray:
    """Return an array with coordinates on all axes, so that arrays of different lengths can be combined."""
    import xarray as xr

    if not isinstance(value, xr.DataArray):
        dims = [f"{name}_{k}" for k in range(np.ndim(value))]
        value = xr.DataArray(value, dims=dims)
    missing = {d: np.arange(n) for d, n in value.sizes.items() if d not in value.coords}
    named: xr.DataArray = value.assign_coords(missing).rename(name)
    return named


def _joined(parts: Iterable[xr.Dataset]) -> xr.Dataset:
    """Return chunks as one dataset, sorted and without duplicate samples."""
    import xarray as xr

    found = xr.concat(
        parts, "sample", data_vars="all", coords="all", compat="override", join="outer"
    )
    # np.unique() sorts, and returns the first of equal samples.
    _, first = np.unique(found["sample"].values, return_index=True)
    found = found.isel(sample=first)
    for name in [
        name for name, values in found.variables.items() if values.dtype.kind == "O"
    ]:
        found[name] = found[name].astype(str)
    return found
