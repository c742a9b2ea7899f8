"""Logs written to disk while a run goes on: in pieces, so that nothing that was written is ever lost.

Each piece is a whole netCDF file, put into its place when it is complete. So whoever looks finds whole
pieces, after a kill or a loss of power too; one file that grows would be lost with its index. At the
end the pieces become one file, and their folder goes.
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
"""Numbers that wait in memory before they are written; 4 MB."""

PIECE_SECONDS = 5.0
"""Wall time after which they are written even if they are few [s]."""

CHUNK_ROWS = 1024
"""Rows that the file keeps together; netCDF's own choice, one row, is slow."""

FINISHED_STATUSES = "complete", "ended"
"""Status of a run that cannot be resumed."""


class StreamedLog(Log):
    """Rows written to disk while a run goes on: memory stays constant.

    Parameters
    ----------
    channels, attributes, not_finite
        As for `Log`.
    path : path
        The netCDF file wanted. Until it is complete, its pieces are in the folder ``path.partial``;
        those that an earlier run left there are deleted.
    resumes : mapping, optional
        Identity of a checkpoint from which the run resumes: rows logged before are kept.
        Without one, a complete file of an equal ``run_hash`` is the result.

    Raises
    ------
    SimulationError
        If nothing can be written there, or another run does; or if the checkpoint is of another run.
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
            self._folder.mkdir(0o755, exist_ok=True)
            self._lock = locked_folder(self._folder, "run")
            self._saved = self._folder / "checkpoint"
            with ExitStack() as unlocked:
                unlocked.enter_context(self._lock)
                self._begin(resumes)
                unlocked.pop_all()
        except WRITE_ERRORS as error:
            raise cannot_write(path, error) from error
        self._written = time.monotonic()

    def _begin(self, resumes: Mapping[str, Any] | None) -> None:
        """Go on from a checkpoint, if that is wanted and there is one; delete what was written after it."""
        pieces = 0
        if resumes is not None and self._saved.exists():
            with Explained(
                lambda e: SimulationError(
                    f"cannot go on from the folder '{self._folder}': {e}"
                )
            ):
                refuse_foreign(self._folder.resolve())
            match read_state(self._saved, resumes):
                case (int(), int(pieces), str(), Snapshot()) as found:
                    self._first, _, self._fault, self.resumed = found
                case _:
                    raise SimulationError(
                        f"cannot go on from '{self._saved}': it is no checkpoint"
                    )
        else:
            self._saved.unlink(missing_ok=True)
            self.finished = resumes is not None and self._is_result()
            if self.finished:
                shutil.rmtree(self._folder, ignore_errors=True)
        for old in pieces_of(self._folder):
            if int(old.stem) >= self._first:
                old.unlink()
        if len(pieces_of(self._folder)) != pieces:
            raise SimulationError(
                f"cannot go on from '{self._saved}': some of the rows before it are not in that folder any "
                "more; leave out resume=True to begin anew"
            )

    def _is_result(self) -> bool:
        """Tell whether the file is there, and what the same run gave when it came to its end."""
        import netCDF4

        with suppress(OSError), netCDF4.Dataset(str(self.path)) as file:
            said = file.__dict__
            return (
                said.get("status") in FINISHED_STATUSES
                and said.get("run_hash") == self.attributes["run_hash"]
            )
        return False

    def _put_aside(self) -> None:
        """Let go of the buffer; rows reach the disk in large pieces, or after a while."""
        super()._put_aside()
        waiting = (self._first - min(self._kept, default=self._first)) * (
            1 + self.width
        )
        if waiting > PIECE_NUMBERS or time.monotonic() - self._written > PIECE_SECONDS:
            self._write_piece()

    def _write_piece(self) -> None:
        """Write what waits in memory; a run without rows gets a piece without rows."""
        if self._kept or not self._first:
            # Named by its first row: if Ctrl-C comes before it is forgotten below, it is written again.
            piece = self._folder / f"{min(self._kept, default=0):015d}.nc"
            try:
                save(self._collected(), piece)
            except SimulationError as error:
                raise self._left(error.__cause__ or error) from error
            self._kept = {}
        self._written = time.monotonic()

    def checkpoint(self, state: Any, of: Mapping[str, Any]) -> None:
        """Write all rows, then the `state` with which a run that is `of` the same goes on from here.

        Raises
        ------
        SimulationError
            If something cannot be written.
        """
        self._put_aside()
        if self._kept:
            self._write_piece()
        write_state(
            self._saved,
            (self._first, len(pieces_of(self._folder)), self._fault, state),
            of,
        )

    def _dataset(self) -> xr.Dataset:
        """Make one file of the pieces, and return it, opened lazily."""
        with uninterrupted():
            import xarray as xr

        try:
            if not self.finished:  # Ctrl-C may come when all is done
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
        """Put one file into the place of the pieces; Ctrl-C leaves these as they are."""
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
            # first: it is nothing without the others
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
                    piece.set_auto_mask(False)
                    start = len(file["time"])
                    for name, values in piece.variables.items():
                        if "time" in values.dimensions:
                            file[name][start : start + len(values)] = values[:]

    def _left(self, error: BaseException) -> SimulationError:
        """Say what can still be read."""
        left = f"what was written before is in '{self._folder}', and recover('{self.path}') reads it"
        return cannot_write(self.path, error, left if pieces_of(self._folder) else "")


def _copy_structure(piece: Any, file: Any) -> None:
    """Create the dimensions and variables of a `piece` in a `file`; copy variables without time."""
    for name, dimension in piece.dimensions.items():
        file.createDimension(name, None if name == "time" else len(dimension))
    for name, values in piece.variables.items():
        logged = "time" in values.dimensions
        chunks = [CHUNK_ROWS, *(max(1, n) for n in values.shape[1:])]
        copied = file.createVariable(
            name, values.dtype, values.dimensions, chunksizes=chunks if logged else None
        )
        attributes = {k: v for k, v in vars(values).items() if k != "_FillValue"}
        copied.setncatts(attributes)
        if logged:
            # Rows come in order: room for two chunks does, where the library takes 16 MB.
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

    What is to be done about what is `not_finite`, and what the run `resumes`, is as for `StreamedLog`.
    """
    if path is None:
        return Log(channels, attributes, not_finite)
    return StreamedLog(channels, attributes, path, not_finite, resumes)


def recover(path: str | Path) -> xr.Dataset:
    """Read what a run that streams its log to `path` has written so far.

    For a run that was killed, or whose disk is full, and, from another process, for one that still
    goes on. Its attribute ``status`` is ``"running"``. The pieces stay where they are: in the folder
    ``path.partial``, until the next run that writes there, or until it is deleted.

    Parameters
    ----------
    path : path
        Argument ``stream_to`` of the run.

    Returns
    -------
    xarray.Dataset
        The rows, in memory. What is too large for that can be read piece by piece: each is a netCDF
        file.

    Raises
    ------
    SimulationError
        If there is nothing to read, or a piece is damaged.

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
            break  # the run has come to its end meanwhile
    else:
        if parts:
            return xr.concat(parts, "time", data_vars="minimal")
    nothing = f"there is nothing to recover for '{path}': no rows in '{_folder(path)}'"
    there = f"; but '{path}' is there, and complete: xarray.open_dataset reads it"
    raise SimulationError(nothing + there * os.path.isfile(path))


def _folder(path: str | Path) -> Path:
    path = Path(path)
    return path.with_name(f"{path.name}.partial")


def _text(value: Any) -> Any:
    return value if isinstance(value, str | int | float) else json.dumps(value)
