"""Cache of compiled libraries on disk, addressed by content and private to one user.

A cached library runs with the user's rights. So a file that another user could have written is not used:
the folder and the files must belong to the user, and no one else may have write permission.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import platformdirs

from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.support.call_site import warn_once
from trussflow.blocks.support.files import is_private, refuse_foreign, replaced
from trussflow.blocks.support.temporary_folders import not_loaded, process_folder

MAX_BYTES = 500_000_000
"""Largest size of the cache [B]; above it, the least recently used files are deleted."""

MAX_AGE, MIN_AGE = 90 * 86_400.0, 3600.0
"""Ages since the last use [s]: older files are deleted, younger ones are kept as they may be in use."""


class CompilationError(TrussflowError):
    """Generated code cannot be compiled, stored or loaded."""


def cache_folder() -> Path:
    """Return the folder of the compile cache: $TRUSSFLOW_CACHE, else in the user's cache folder."""
    given = os.environ.get("TRUSSFLOW_CACHE")
    return Path(given) if given else Path(platformdirs.user_cache_dir("trussflow"))


def cache_size() -> int:
    """Return the size of all files in the cache [B]."""
    return sum(size for _, size, _ in _files(cache_folder()))


def cached(
    content: str,
    suffix: str,
    build: Callable[[], bytes],
    check: Callable[[Path], object] = Path.stat,
) -> Path:
    """Return the cached file that was built from this content, or build it.

    The file is stored with its hash. It is built again if the hash does not match or the check fails.
    It is moved into place atomically, so two processes may build it at the same time. If the cache
    cannot be used, a temporary folder of this process is used. When a process stores its first file, it
    also deletes files older than `MAX_AGE`, and the least recently used ones above `MAX_BYTES`.

    Parameters
    ----------
    content : str
        Everything that determines the file, the tools included.
    suffix : str
        Suffix of the file name.
    build : callable
        Returns the bytes of the file; called only if the cache has no valid file.
    check : callable
        Takes the path, and raises OSError or AttributeError if the file is not usable.

    Raises
    ------
    CompilationError
        If a newly built file is not usable either, or cannot be stored.
    """
    name = f"{hashlib.sha256(content.encode()).hexdigest()[:32]}{suffix}"
    for folder in _folders():
        if _is_intact(folder / name) and _fault(check, folder / name) is None:
            return folder / name
    binary = build()
    faults: dict[Path, str] = {}
    for folder in _folders():
        fault = _fault(_store, folder / name, binary) or _fault(check, folder / name)
        if fault is None:
            for (
                at,
                reason,
            ) in faults.items():  # the file is usable, so the folder is at fault
                _not_kept(at, reason)
            _prune(folder)
            return folder / name
        faults[folder] = fault
    raise CompilationError(
        f"cannot store and load the compiled library, last tried in '{folder}': {fault}"
    )


def _fault(action: Callable[..., object], *arguments: object) -> str | None:
    """Call an action on a file; return the message of its failure, or None."""
    try:
        action(*arguments)
    except (OSError, AttributeError) as error:
        return not_loaded(error)
    return None


def _files(folder: Path) -> list[tuple[float, int, Path]]:
    """Return the time of the last use [s], the size [B] and the path of each compiled file in a folder."""
    found = []
    for file in folder.glob(f"{'[0-9a-f]' * 32}.*o"):
        with contextlib.suppress(OSError):  # another process may delete it
            status = file.stat()
            found.append((status.st_mtime, status.st_size, file))
    return found


@functools.cache
def _prune(folder: Path) -> None:
    """Delete files of a folder that exceed `MAX_AGE`, and the oldest above `MAX_BYTES`; once per process."""
    total, now = 0, time.time()
    for used, size, file in sorted(_files(folder), reverse=True):
        total += size
        if now - used > MAX_AGE or (total > MAX_BYTES and now - used > MIN_AGE):
            with contextlib.suppress(OSError):
                # another process may delete it or, on Windows, have it loaded
                if file.stat().st_mtime == used:  # not used since the list was made
                    file.with_suffix(".sha256").unlink(missing_ok=True)
                    file.unlink()


def _folders() -> Iterator[Path]:
    """Yield the folders of the cache: that of the user, then a temporary one of this process."""
    folder = cache_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = folder.resolve()  # a link to a folder is allowed
        refuse_foreign(folder)
        yield folder
    except OSError as error:
        _not_kept(folder, error)
    yield process_folder()


def _not_kept(folder: Path, error: object) -> None:
    warn_once(
        "cache",
        f"compiled code cannot be cached in '{folder}', so each process compiles again: {error}",
    )


def _is_intact(file: Path) -> bool:
    """Return whether a file exists, is private to the user, and matches its stored hash."""
    beside = file.with_suffix(".sha256")
    try:
        if not (is_private(file, stat.S_IFREG) and is_private(beside, stat.S_IFREG)):
            return False
        with contextlib.suppress(OSError):  # the folder may be read-only
            # marks the file as used, so that `_prune` of another process keeps it
            os.utime(file)
        return hashlib.sha256(file.read_bytes()).hexdigest() == beside.read_text(
            encoding="ascii"
        )
    except (OSError, UnicodeDecodeError):
        return False


def _store(file: Path, binary: bytes) -> None:
    """Write a file and its hash, each atomically; an existing file, link or folder is replaced."""
    digest = hashlib.sha256(binary).hexdigest().encode("ascii")
    for path, content in ((file, binary), (file.with_suffix(".sha256"), digest)):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.is_symlink() or not path.is_file():
            path.unlink(missing_ok=True)
        with replaced(path) as partial:
            partial.touch(0o600)
            partial.write_bytes(content)
