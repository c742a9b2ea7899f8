"""Folders of netCDF files that one process writes piece by piece: streamed logs and sweeps."""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.results.dataset import load
from trussflow.blocks.support.files import locked
from trussflow.blocks.support.interrupts import uninterrupted

if TYPE_CHECKING:
    import xarray as xr


def locked_folder(folder: Path, writer: str) -> IO[str]:
    """Lock a `folder` for a `writer`, a run or a sweep, until the returned file is closed.

    Raises
    ------
    SimulationError
        If another process writes there.
    OSError
        If there is no such folder, or nothing can be written there.
    """
    try:
        return locked(folder / "lock")
    except BlockingIOError:
        raise SimulationError(
            f"another {writer} is writing to '{folder}'; give this one another path"
        ) from None


def pieces_of(folder: Path) -> list[Path]:
    """Return the pieces in a folder, in the order of their numbers."""
    # Numbers have leading zeros, so the order of the names is that of the numbers.
    return sorted(folder.glob("[0-9]*.nc"))


def read_piece(piece: Path, without: str) -> xr.Dataset:
    """Return the data of a piece.

    Parameters
    ----------
    piece : pathlib.Path
        The file.
    without : str
        Consequence of deleting the file, for the message.

    Raises
    ------
    SimulationError
        If it cannot be read.
    """
    try:
        with uninterrupted():  # an interrupt could leave a lock of xarray taken
            return load(piece)
    except SimulationError as error:
        raise SimulationError(f"{error}; without it, {without}") from error
