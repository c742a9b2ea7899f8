"""Safe reading and unpacking of FMU archives from untrusted origin."""

from __future__ import annotations

import lzma
import shutil
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from trussflow.blocks.support.files import reading
from trussflow.blocks.support.temporary_folders import process_folder, with_place
from trussflow.blocks.support.validation import shown
from trussflow.fmu.errors import FmuArchiveError

MAX_BYTES = 2_000_000_000
"""Maximum unpacked size of an archive [B]; the largest known FMUs have about 500 MB.

Users may set it to a larger value."""

MAX_FILES = 50_000
"""Maximum number of files of an archive."""

MAX_XML_BYTES = 100_000_000
"""Maximum size of a model description [B]."""

ARCHIVE_ERRORS = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    NotImplementedError,
)
"""Errors raised while reading a damaged archive or one with an unknown compression."""

DESCRIPTION_FILE = "modelDescription.xml"
"""Name of the model description inside every FMU."""


@contextmanager
def opened(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open an FMU and check all names and sizes in it before unpacking.

    Parameters
    ----------
    path : pathlib.Path
        The FMU.

    Raises
    ------
    FmuArchiveError
        If the file is not a zip archive, is damaged, or has unsafe names, links or sizes.
    """
    damaged = "it is not a zip archive, or it is damaged ({})"
    with reading(path, FmuArchiveError, "cannot open", damaged) as file:
        archive = zipfile.ZipFile(file)
    try:
        with archive:
            if fault := next(_faults(archive.infolist()), None):
                raise FmuArchiveError(f"refused to unpack '{path}': {fault}")
            yield archive
    except ARCHIVE_ERRORS as error:
        raise FmuArchiveError(
            f"cannot open '{path}': {damaged.format(error)}"
        ) from error
    except OSError as error:
        raise FmuArchiveError(
            f"cannot open or unpack '{path}' {with_place(error)}"
        ) from error


def _faults(members: list[zipfile.ZipInfo]) -> Iterator[str]:
    """Yield the reasons why unpacking an archive is unsafe."""
    if len(members) > MAX_FILES:
        yield f"it has {len(members)} files, more than {MAX_FILES}"
    size = sum(member.file_size for member in members)
    if size > MAX_BYTES:
        yield (
            f"it would take {size / 1e6:.4g} MB, more than {MAX_BYTES / 1e6:.4g} MB; if you trust it, "
            f"increase {__name__}.MAX_BYTES"
        )
    # Lookup by name returns the last of equal entries; another tool may use the first.
    seen: dict[str, tuple[int, int]] = {}
    for member in members:
        if reason := _harm(member):
            name = shown(member.filename)
            yield f"{reason} ({name}); an archive may only have plain files below its own folder"
        content = member.file_size, member.CRC
        if seen.setdefault(member.filename, content) != content:
            yield f"{shown(member.filename)} is there twice, with different contents"


def _harm(member: zipfile.ZipInfo) -> str:
    """Return the fault of an entry; empty if it has none."""
    # `filename` is cut at a null character and has converted separators.
    name = member.orig_filename
    parts = PurePosixPath(name).parts
    if "\\" in name or ":" in name or "\0" in name or any(ord(c) < 32 for c in name):
        return "a name has characters that are not allowed in a path"
    if not parts or name.startswith("/") or ".." in parts:
        return "a path leads outside the archive"
    # Upper half: Unix mode; it is 0 in archives of other systems.
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "an entry is a link or a special file"
    if member.flag_bits & 0x1:
        return "an entry is encrypted"
    return ""


def read_description(path: Path) -> tuple[bytes, frozenset[str]]:
    """Return the bytes of the model description of an FMU, and the names of all its files.

    Parameters
    ----------
    path : pathlib.Path
        The FMU.

    Raises
    ------
    FmuArchiveError
        If the archive is refused, or has no model description.
    """
    with opened(path) as archive:
        if DESCRIPTION_FILE not in archive.namelist():
            raise FmuArchiveError(
                f"cannot read FMU '{path}': it has no {DESCRIPTION_FILE} at its top level"
            )
        member = archive.getinfo(DESCRIPTION_FILE)
        if member.file_size > MAX_XML_BYTES:
            raise FmuArchiveError(
                f"cannot read FMU '{path}': its {DESCRIPTION_FILE} has {member.file_size / 1e6:.4g} MB, "
                f"more than {MAX_XML_BYTES / 1e6:.4g} MB"
            )
        return archive.read(member), frozenset(archive.namelist())


def unpack(path: Path, place: Path | None = None) -> Path:
    """Unpack an FMU into a new temporary folder, which the caller must delete.

    Parameters
    ----------
    path : pathlib.Path
        The FMU.
    place : pathlib.Path, optional
        Parent folder; by default the temporary folder of this process.

    Raises
    ------
    FmuArchiveError
        If the archive is refused or damaged; the folder is deleted then.
    """
    with opened(path) as archive:
        folder = Path(tempfile.mkdtemp(prefix="fmu-", dir=place or process_folder()))
        try:
            archive.extractall(folder)
        except BaseException:
            remove(folder)
            raise
    return folder


def remove(folder: Path) -> None:
    """Delete a folder created by `unpack`, if it still exists.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    """
    shutil.rmtree(folder, ignore_errors=True)
