"""Writing files: FMUs, SSP files that hold FMUs, and C."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from trussflow.blocks.framework.files import destination, replaced
from trussflow.blocks.framework.validation import as_path
from trussflow.fmu.errors import ExportError

PACKED = (".fmu",)
"""Endings of files that are archives themselves; these are not compressed again."""


def write(path: Path, files: Mapping[str, bytes | Path]) -> None:
    """Write an archive in one piece: the same files give the same bytes.

    Parameters
    ----------
    path : Path
        The file.
    files : mapping
        Contents, or the file that has them, by path in the archive.

    Raises
    ------
    ExportError
        If it cannot be written.
    """
    with written(path) as partial, zipfile.ZipFile(partial, "w") as archive:
        for inner, content in files.items():
            info = zipfile.ZipInfo(inner)  # of a fixed date
            packed = inner.endswith(PACKED)
            info.compress_type = zipfile.ZIP_STORED if packed else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, content.read_bytes() if isinstance(content, Path) else content)


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """Yield where to write what appears at `path` in one piece.

    Raises
    ------
    ExportError
        If it cannot be written.
    """
    try:
        with replaced(path) as partial:
            yield partial
    except OSError as error:
        raise ExportError(f"cannot write '{path}': {error}") from error


def check_writable(path: str | Path) -> Path:
    """Return a path, or refuse one that cannot be written before the long work starts.

    Parameters
    ----------
    path : str or Path
        The file.

    Raises
    ------
    ExportError
        Naming the path and what is wrong with it.
    """
    path = as_path(ExportError, "cannot write", path)
    fault = ""
    try:
        folder = destination(path).parent
        if not folder.is_dir():
            fault = f"there is no folder '{folder}'"
        elif not os.access(folder, os.W_OK):
            fault = f"the folder '{folder}' is not writable"
    except OSError as error:
        fault = f"{error}; name a file, such as plant.fmu"
    if fault:
        raise ExportError(f"cannot write '{path}': {fault}")
    return path
