"""The FMU as a file: a zip archive from elsewhere, opened without trusting it."""

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

from trussflow.blocks.framework.files import reading
from trussflow.blocks.framework.temporary import process_folder, with_place
from trussflow.blocks.framework.validation import positive, shown
from trussflow.fmu.errors import FmuArchiveError

MAX_BYTES = 2_000_000_000
"""Unpacked size [B] above which an archive is refused; the largest FMUs known have some 500 MB."""

MAX_FILES = 50_000
"""Number of files above which an archive is refused."""

MAX_XML_BYTES = 100_000_000
"""Size [B] above which a model description is refused."""

DAMAGE = (zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError)
"""What reading a damaged archive, or one of an unknown kind, raises."""

DESCRIPTION = "modelDescription.xml"
"""Name of the model description inside every FMU."""


@contextmanager
def opened(path: Path, max_bytes: float = MAX_BYTES) -> Iterator[zipfile.ZipFile]:
    """Open an FMU and check every name and size in it before anything is unpacked.

    Parameters
    ----------
    path : pathlib.Path
        The FMU.
    max_bytes : float
        Unpacked size allowed [B].

    Raises
    ------
    FmuArchiveError
        If it is no zip archive, is damaged, or has names, links or sizes that do harm; or if `max_bytes`
        is no size.
    """
    positive(FmuArchiveError, max_bytes=max_bytes)
    damaged = "it is no zip archive, or a damaged one ({})"
    with reading(path, FmuArchiveError, "cannot open", damaged) as file:
        archive = zipfile.ZipFile(file)
    try:
        with archive:
            if fault := next(_faults(archive.infolist(), max_bytes), None):
                raise FmuArchiveError(f"refused to unpack '{path}': {fault}")
            yield archive
    except DAMAGE as error:
        raise FmuArchiveError(f"cannot open '{path}': {damaged.format(error)}") from error
    except OSError as error:
        raise FmuArchiveError(f"cannot open or unpack '{path}' {with_place(error)}") from error


def _faults(members: list[zipfile.ZipInfo], max_bytes: float) -> Iterator[str]:
    """Say why an archive would write outside its folder, or fill the disk."""
    if len(members) > MAX_FILES:
        yield f"it has {len(members)} files, more than {MAX_FILES}"
    size = sum(member.file_size for member in members)
    if size > max_bytes:
        yield (
            f"it would take {size / 1e6:.4g} MB, more than {max_bytes / 1e6:.4g} MB; if you trust it, "
            "allow more with max_bytes"
        )
    seen: dict[str, tuple[int, int]] = {}
    for member in members:
        if reason := _harm(member):
            name = shown(member.filename)
            yield f"{reason} ({name}); an archive may only have plain files below its own folder"
        content = member.file_size, member.CRC
        if seen.setdefault(member.filename, content) != content:
            yield f"{shown(member.filename)} is there twice, with different contents"


def _harm(member: zipfile.ZipInfo) -> str:
    """Say what is wrong with an entry; empty if nothing is."""
    name = member.orig_filename
    parts = PurePosixPath(name).parts
    if "\\" in name or ":" in name or "\0" in name or any(ord(c) < 32 for c in name):
        return "a name has characters that are no part of a path"
    if not parts or name.startswith("/") or ".." in parts:
        return "a path leads outside the archive"
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "an entry is a link or a special file"
    if member.flag_bits & 0x1:
        return "an entry is encrypted"
    return ""


def read_description(path: Path, max_bytes: float = MAX_BYTES) -> tuple[bytes, frozenset[str]]:
    """Return the model description of an FMU as it stands, and the names of all its files.

    Parameters
    ----------
    path : pathlib.Path
        The FMU.
    max_bytes : float
        Unpacked size allowed [B].

    Raises
    ------
    FmuArchiveError
        If the archive is refused, or there is no model description in it.
    """
    with opened(path, max_bytes) as archive:
        try:
            member = archive.getinfo(DESCRIPTION)
        except KeyError:
            raise FmuArchiveError(f"cannot read FMU '{path}': there is no {DESCRIPTION} at its top") from None
        if member.file_size > MAX_XML_BYTES:
            raise FmuArchiveError(
                f"cannot read FMU '{path}': its {DESCRIPTION} has {member.file_size / 1e6:.4g} MB, "
                f"more than {MAX_XML_BYTES / 1e6:.4g} MB"
            )
        return archive.read(member), frozenset(archive.namelist())


def unpack(path: Path, max_bytes: float = MAX_BYTES, place: Path | None = None) -> Path:
    """Unpack an FMU into a new temporary folder, which the caller deletes.

    Parameters
    ----------
    path : pathlib.Path
        The FMU.
    max_bytes : float
        Unpacked size allowed [B].
    place : pathlib.Path, optional
        Where the folder is to be; by default in that of this process.

    Raises
    ------
    FmuArchiveError
        If the archive is refused or damaged; nothing is left on disk then.
    """
    with opened(path, max_bytes) as archive:
        folder = Path(tempfile.mkdtemp(prefix="fmu-", dir=place or process_folder()))
        try:
            archive.extractall(folder)
        except BaseException:
            remove(folder)
            raise
    return folder


def remove(folder: Path) -> None:
    """Delete a folder made by `unpack`, if it is still there.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    """
    shutil.rmtree(folder, ignore_errors=True)
