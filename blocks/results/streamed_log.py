"""Logs that are written to disk during a run, in pieces, so that no written rows are lost.

Each piece is a complete netCDF file, which is written atomically. So all pieces can be read, also after a
kill or a loss of power; a single growing file could not be read without its index. At the end, the pieces
are joined to one file, and their folder is deleted.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trussflow.blocks.errors import Explained, SimulationError, SimulationInterrupted
from trussflow.blocks.results.channels import Channel
from trussflow.blocks.results.dataset import (
    WRITE_ERRORS,
    cannot_write,
    refuse_other_kinds,
    save,
)
from trussflow.blocks.results.log import Log
from trussflow.blocks.results.pieces import locked_folder, pieces_of, read_piece
from trussflow.blocks.results.state_file import Snapshot, read_state, write_state
from trussflow.blocks.support.files import destination, refuse_foreign, replaced
from trussflow.blocks.support.interrupts import uninterrupted

if TYPE_CHECKING:
    import xarray as xr

PIECE_NUMBERS = 500_000
"""Maximum number of numbers in memory before they are written; 4 MB."""

PIECE_SECONDS = 5.0
"""Wall time after which rows are written, even if they are few [s]."""

CHUNK_ROWS = 1024
"""Rows in a chunk of the file; netCDF's default, one row, is slow [-]."""

FINISHED_STATUSES = "complete", "ended"
"""Status of a run that cannot be resumed."""


class StreamedLog(Log):
    """Rows written to disk during a run, with constant memory.

    Parameters
    ----------
    channels, attributes, not_finite
        As for `Log`.
    path : path
        The netCDF file. Until it is complete, its pieces are in the folder ``path.partial``; pieces of
        an earlier run there are deleted.
    resumes : mapping, optional
        Identity of a checkpoint from which the run resumes: rows logged before are kept.
        Without one, a complete file of an equal ``run_hash`` is the result.

    Raises
    ------
    SimulationError
        If the file cannot be written, another run writes to it, or the checkpoint is of another run.
    """

    def __init__(
        self,
        channels: Sequence[Channel],
        attributes: Mapping[str, Any],
        path: str | Path,
        not_finite: str = "ignore",
        resumes: Mapping[str, Any] | None = None,
    ) -> None:
        refuse_other_kinds(path)
        super().__init__(channels, {**attributes, "status": "running"}, not_finite)
        self.path, self._folder = Path(path), _folder(path)
        try:
            destination(path)
            # Not writable for others, whatever the umask: a checkpoint
            # is read from there.
            self._folder.mkdir(0o755, exist_ok=True)
            self._lock = locked_folder(self._folder, "run")
            self._saved = self._folder / "checkpoint"
            # Unlocked if `_begin` raises; otherwise the lock lasts until the run ends.
            with ExitStack() as unlocked:
                unlocked.enter_context(self._lock)
                self._begin(resumes)
                unlocked.pop_all()
        except WRITE_ERRORS as error:
            raise cannot_write(path, error) from error
        self._written = time.monotonic()

    def _begin(self, resumes: Mapping[str, Any] | None) -> None:
        """Resume from a checkpoint if there is one and `resumes` is given; delete the rows after it."""
        pieces = 0
        if resumes is not None and self._saved.exists():
            with Explained(
                lambda e: SimulationError(
                    f"cannot continue from the folder '{self._folder}': {e}"
                )
            ):
                # A state that someone else wrote must not be restored.
                refuse_foreign(self._folder.resolve())
            match read_state(self._saved, resumes):
                case (int(), int(pieces), str(), Snapshot()) as found:
                    self._first, _, self._fault, self.resumed = found
                case _:
                    raise SimulationError(
                        f"cannot continue from '{self._saved}': it is no checkpoint"
                    )
        else:
            self._saved.unlink(missing_ok=True)
            self.finished = resumes is not None and self._is_result()
            if self.finished:
                shutil.rmtree(self._folder, ignore_errors=True)
        for old in pieces_of(self._folder):
            # Written after the checkpoint: the resumed run writes these rows again.
            if int(old.stem) >= self._first:
                old.unlink()
        if len(pieces_of(self._folder)) != pieces:
            raise SimulationError(
                f"cannot continue from '{self._saved}': some of the rows before it are not in that folder any "
                "more; leave out resume=True to start again"
            )

    def _is_result(self) -> bool:
        """Return whether the file is the complete result of an equal run."""
        import netCDF4

        with suppress(OSError), netCDF4.Dataset(str(self.path)) as file:
            said = file.__dict__
            return (
                said.get("status") in FINISHED_STATUSES
                and said.get("run_hash") == self.attributes["run_hash"]
            )
        return False

    def _put_aside(self) -> None:
        """Move the rows of the buffer to the kept rows, and write these if they are many or old."""
        super()._put_aside()
        # Rows in memory: those from the first kept one on.
        waiting = (self._first - min(self._kept, default=self._first)) * (
            1 + self.width
        )
        if waiting > PIECE_NUMBERS or time.monotonic() - self._written > PIECE_SECONDS:
            self._write_piece()

    def _write_piece(self) -> None:
        """Write the rows in memory; a run without rows gets a piece without rows."""
        if self._kept or not self._first:
            # Named by its first row: if Ctrl-C comes before `_kept` is cleared, the next call
            # replaces the piece by an equal one.
            piece = self._folder / f"{min(self._kept, default=0):015d}.nc"
            try:
                save(self._collected(), piece)
            except SimulationError as error:
                raise self._left(error.__cause__ or error) from error
            self._kept = {}
        self._written = time.monotonic()

    def checkpoint(self, state: Any, of: Mapping[str, Any]) -> None:
        """Write all rows, then the `state` from which a run with the identity `of` can resume.

        Raises
        ------
        SimulationError
            If a file cannot be written.
        """
        self._put_aside()
        # Rows before the state: after a kill in between, the older
        # checkpoint still fits.
        if self._kept:
            self._write_piece()
        write_state(
            self._saved,
            (self._first, len(pieces_of(self._folder)), self._fault, state),
            of,
        )

    def _dataset(self) -> xr.Dataset:
        """Join the pieces to one file, and return its dataset, opened lazily."""
        with uninterrupted():
            import xarray as xr

        try:
            if not self.finished:  # Ctrl-C may have come after the file was complete
                self._put_aside()
                self._write_piece()
                self._replace()
        except WRITE_ERRORS as error:
            raise self._left(error) from error
        finally:
            self._lock.close()
        with uninterrupted():
            return xr.open_dataset(self.path, engine="netcdf4", decode_cf=False)

    def _replace(self) -> None:
        """Replace the pieces by one file; Ctrl-C does not change them."""
        try:
            with replaced(self.path) as target:
                self._join(target)
        except KeyboardInterrupt:
            raise SimulationInterrupted(
                str(self._left(KeyboardInterrupt("Ctrl-C came")))
            ) from None
        with uninterrupted():
            self.finished = True
            if (
                self._saved.exists()
                and self.attributes["status"] not in FINISHED_STATUSES
            ):
                return  # the run can be resumed
            # The checkpoint first, as it is useless without the pieces.
            self._saved.unlink(missing_ok=True)
            shutil.rmtree(self._folder, ignore_errors=True)

    def _join(self, target: Path) -> None:
        """Write all pieces, one after the other, to one file."""
        import netCDF4

        first, *_ = pieces = pieces_of(self._folder)
        with netCDF4.Dataset(str(target), "w") as file:
            file.setncatts({k: _text(v) for k, v in self.attributes.items()})
            with netCDF4.Dataset(str(first)) as piece:
                _copy_structure(piece, file)
            for path in pieces:
                with netCDF4.Dataset(str(path)) as piece:
                    # Otherwise netCDF4 would return masked arrays where numbers
                    # equal the fill value.
                    piece.set_auto_mask(False)
                    start = len(file["time"])
                    for name, values in piece.variables.items():
                        if "time" in values.dimensions:
                            file[name][start : start + len(values)] = values[:]

    def _left(self, error: BaseException) -> SimulationError:
        """Return an error that names the rows that can still be read."""
        left = f"the rows written before are in '{self._folder}', and recover('{self.path}') reads them"
        return cannot_write(self.path, error, left if pieces_of(self._folder) else "")


def _copy_structure(piece: Any, file: Any) -> None:
    """Create the dimensions and variables of a `piece` in a `file`; copy variables without time."""
    for name, dimension in piece.dimensions.items():
        # None: an unlimited dimension, which grows with the rows.
        file.createDimension(name, None if name == "time" else len(dimension))
    for name, values in piece.variables.items():
        logged = "time" in values.dimensions
        chunks = [CHUNK_ROWS, *(max(1, n) for n in values.shape[1:])]
        copied = file.createVariable(
            name, values.dtype, values.dimensions, chunksizes=chunks if logged else None
        )
        # netCDF sets _FillValue only when a variable is created.
        attributes = {k: v for k, v in vars(values).items() if k != "_FillValue"}
        copied.setncatts(attributes)
        if logged:
            # Rows come in order, so two chunks are enough; the library's default is 16 MB.
            copied.set_var_chunk_cache(size=2 * 8 * math.prod(chunks))
        else:
            copied[:] = values[:]


def opened(
    channels: Sequence[Channel],
    attributes: Mapping[str, Any],
    path: str | Path | None,
    not_finite: str,
    resumes: Mapping[str, Any] | None = None,
) -> Log:
    """Return a log of `channels` with `attributes` on disk, or in memory if there is no `path`.

    The policy `not_finite`, and the identity `resumes`, are as for `StreamedLog`.
    """
    if path is None:
        return Log(channels, attributes, not_finite)
    return StreamedLog(channels, attributes, path, not_finite, resumes)


def recover(path: str | Path) -> xr.Dataset:
    """Read the rows that a run with ``stream_to=path`` has written so far.

    The run may have been killed, its disk may be full, or it may still run in another process. The
    attribute ``status`` is ``"running"``. The pieces stay in the folder ``path.partial`` until the next run writes
    there, or until the folder is deleted.

    Parameters
    ----------
    path : path
        Argument ``stream_to`` of the run.

    Returns
    -------
    xarray.Dataset
        The rows, in memory. If they are too many, the pieces can be read one by one: each is a netCDF
        file.

    Raises
    ------
    SimulationError
        If there are no pieces, or one is damaged.

    Examples
    --------
    ::

        result = recover("night.nc")
        save(result, "night.nc")
    """
    refuse_other_kinds(path, "recover")
    with uninterrupted():
        import xarray as xr
    parts = []
    for piece in pieces_of(_folder(path)):
        try:
            parts.append(read_piece(piece, "recover reads the others"))
        except SimulationError:
            if piece.exists():
                raise
            break  # the run has ended meanwhile, and deleted its pieces
    else:
        if parts:
            with Explained(
                lambda e: SimulationError(
                    f"cannot join the pieces in '{_folder(path)}': {e}"
                )
            ):
                return xr.concat(parts, "time", data_vars="minimal")
    nothing = f"there is nothing to recover for '{path}': no rows in '{_folder(path)}'"
    there = f"; but '{path}' is there, and complete: xarray.open_dataset reads it"
    raise SimulationError(nothing + there * os.path.isfile(path))


def _folder(path: str | Path) -> Path:
    path = Path(path)
    return path.with_name(f"{path.name}.partial")


def _text(value: Any) -> Any:
    return value if isinstance(value, str | int | float) else json.dumps(value)
