"""Atomic writing of FMUs, SSP files and C files."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from trussflow.blocks.support.files import destination, replaced
from trussflow.blocks.support.validation import as_path
from trussflow.fmu.errors import ExportError


def write(path: Path, files: Mapping[str, bytes | Path]) -> None:
    """Write an archive atomically; equal files give equal bytes.

    Parameters
    ----------
    path : Path
        The file.
    files : mapping
        Contents, or the file with the contents, by path in the archive.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    with written(path) as partial, zipfile.ZipFile(partial, "w") as archive:
        for inner, content in files.items():
            info = zipfile.ZipInfo(inner)  # it has a fixed date
            packed = inner.endswith(".fmu")
            # An FMU in an SSP file is compressed already.
            info.compress_type = zipfile.ZIP_STORED if packed else zipfile.ZIP_DEFLATED
            # Unix mode; without it the unpacked files may be unreadable.
            info.external_attr = 0o644 << 16
            archive.writestr(
                info, content.read_bytes() if isinstance(content, Path) else content
            )


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """Yield a temporary file that replaces `path` at the end.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    try:
        with replaced(path) as partial:
            yield partial
    except OSError as error:
        raise ExportError(f"cannot write '{path}': {error}") from error


def check_writable(path: str | Path) -> Path:
    """Return a path; raise an error if it is not writable, before the export starts.

    Parameters
    ----------
    path : str or Path
        The file.

    Raises
    ------
    ExportError
        If the path is not writable.
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
