"""Cache of compiled libraries on disk, addressed by content and private to one user.

The name of a file consists of the hash of its source, and of the hash of the file itself.
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

    It is built again if its own hash does not match or the check fails.
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
    key = _hash(content.encode())
    for folder in _folders():
        # A key may have several files, as compilers need not reproduce output.
        for file in folder.glob(f"{key}-*{suffix}"):
            if _is_intact(file) and _fault(check, file) is None:
                return file
    binary = build()
    name = f"{key}-{_hash(binary)}{suffix}"
    faults: dict[Path, str] = {}
    for folder in _folders():
        file = folder / name
        fault = _fault(_store, file, binary) or _fault(check, file)
        if fault is None:
            # the file is usable, so folders before this one are at fault
            for unusable, reason in faults.items():
                _not_kept(unusable, reason)
            _prune(folder)
            return file
        faults[folder] = fault
    raise CompilationError(
        f"cannot store and load the compiled library, last tried in '{folder}': {fault}"
    )


def _hash(content: bytes) -> str:
    """Return half of the SHA-256 hash [-], which is long enough for file names."""
    return hashlib.sha256(content).hexdigest()[:32]


def _fault(action: Callable[..., object], *arguments: object) -> str | None:
    """Call an action on a file; return the message of its failure, or None."""
    try:
        action(*arguments)
    # ctypes raises AttributeError for a library without a required function.
    except (OSError, AttributeError) as error:
        return not_loaded(error)
    return None


def _files(folder: Path) -> list[tuple[float, int, Path]]:
    """Return the time of the last use [s], the size [B] and the path of each cached file in a folder."""
    found = []
    for file in folder.glob(f"{'[0-9a-f]' * 32}*"):
        with contextlib.suppress(OSError):  # another process may delete it
            status = file.stat()
            found.append((status.st_mtime, status.st_size, file))
    return found


@functools.cache
def _prune(folder: Path) -> None:
    """Delete files of a folder that exceed `MAX_AGE`, and the oldest above `MAX_BYTES`; once per process."""
    total, now = 0, time.time()
    # The latest first, so that the sum is the size of all files used since.
    for used, size, file in sorted(_files(folder), reverse=True):
        total += size
        if now - used > MAX_AGE or (total > MAX_BYTES and now - used > MIN_AGE):
            with contextlib.suppress(OSError):
                # another process may delete it or, on Windows, have it loaded
                if file.stat().st_mtime == used:  # not used since the list was made
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
    """Return whether a file is private to the user, and matches the hash in its name."""
    try:
        if not is_private(file, stat.S_IFREG):
            return False
        with contextlib.suppress(OSError):  # the folder may be read-only
            # marks the file as used, so that `_prune` of another process keeps it
            os.utime(file)
        return file.stem.endswith(f"-{_hash(file.read_bytes())}")
    except OSError:
        return False


def _store(file: Path, binary: bytes) -> None:
    """Write a file atomically; an existing file, link or folder is replaced."""
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    elif file.is_symlink() or not file.is_file():
        file.unlink(missing_ok=True)
    with replaced(file) as partial:
        # Private before it has content, regardless of the umask.
        partial.touch(0o600)
        partial.write_bytes(binary)
