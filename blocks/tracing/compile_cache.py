"""What was compiled, kept on disk by content, for the user who compiled it and nobody else.

What is loaded from here runs with the user's rights. So nothing is taken that another user could have
written: the folder and the files must be the user's own, with no others allowed to write to them.
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

from trussflow.blocks.framework.call_site import warn_once
from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.files import is_private, refuse_foreign, replaced
from trussflow.blocks.framework.temporary import not_loaded, process_folder

MAX_BYTES = 500_000_000
"""Size of the cache above which the files used longest ago are deleted [B]."""

MAX_AGE, MIN_AGE = 90 * 86_400.0, 3600.0
"""Times since the last use: files above the first are deleted, those below the second may be in use [s]."""


class CompilationError(TrussflowError):
    """Code that was generated cannot be compiled, kept or loaded."""


def cache_folder() -> Path:
    """Return where compiled code is kept: $TRUSSFLOW_CACHE, else the user's cache folder."""
    given = os.environ.get("TRUSSFLOW_CACHE")
    return Path(given) if given else Path(platformdirs.user_cache_dir("trussflow"))


def cache_size() -> int:
    """Return the size of all files in the cache [B]."""
    return sum(size for _, size, _ in _files(cache_folder()))


def cached(
    content: str, suffix: str, build: Callable[[], bytes], check: Callable[[Path], object] = Path.stat
) -> Path:
    """Return the file in the cache that was built from this content, or build it.

    It is stored next to its hash, and built again if that does not match or it does not pass the
    check. It is moved into place in one piece, so two processes may build at once. Where the cache
    cannot be used, a folder of this process takes its place. The first file that a process stores
    there makes it delete files that are older than `MAX_AGE`, and the oldest above `MAX_BYTES`.

    Parameters
    ----------
    content : str
        What the file is made from, the tools included.
    suffix : str
        Ending of its name.
    build : callable
        Returns the bytes of the file; called only if nothing suitable is in the cache.
    check : callable
        Takes the file, and raises OSError or AttributeError if it is not good.

    Raises
    ------
    CompilationError
        If a new file is not good either, or cannot be stored anywhere.
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
            for at, reason in faults.items():  # so it was not the file
                _not_kept(at, reason)
            _prune(folder)
            return folder / name
        faults[folder] = fault
    raise CompilationError(f"cannot store and load what was compiled, at last in '{folder}': {fault}")


def _fault(action: Callable[..., object], *arguments: object) -> str | None:
    """Do something with a file; return what is wrong with it."""
    try:
        action(*arguments)
    except (OSError, AttributeError) as error:
        return not_loaded(error)
    return None


def _files(folder: Path) -> list[tuple[float, int, Path]]:
    """Return the time of the last use [s], the size [B] and the path of each compiled file in a folder."""
    found = []
    for file in folder.glob(f"{'[0-9a-f]' * 32}.*o"):
        with contextlib.suppress(OSError):  # another process deletes it
            status = file.stat()
            found.append((status.st_mtime, status.st_size, file))
    return found


@functools.cache
def _prune(folder: Path) -> None:
    """Delete the files of a folder that are too old, and the oldest above `MAX_BYTES`; once in a process."""
    total, now = 0, time.time()
    for used, size, file in sorted(_files(folder), reverse=True):
        total += size
        if now - used > MAX_AGE or (total > MAX_BYTES and now - used > MIN_AGE):
            with contextlib.suppress(OSError):  # another process deletes it or, on Windows, has it loaded
                if file.stat().st_mtime == used:  # not used meanwhile
                    file.with_suffix(".sha256").unlink(missing_ok=True)
                    file.unlink()


def _folders() -> Iterator[Path]:
    """Yield the folders to look into and to store in: the user's, and one of this process."""
    folder = cache_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = folder.resolve()  # a link to a folder is fine
        refuse_foreign(folder)
        yield folder
    except OSError as error:
        _not_kept(folder, error)
    yield process_folder()


def _not_kept(folder: Path, error: object) -> None:
    warn_once("cache", f"compiled code is not kept in '{folder}', so each process compiles anew: {error}")


def _is_intact(file: Path) -> bool:
    """Tell whether a file is there, ours alone, and matches the hash stored beside it."""
    beside = file.with_suffix(".sha256")
    try:
        if not (is_private(file, stat.S_IFREG) and is_private(beside, stat.S_IFREG)):
            return False
        with contextlib.suppress(OSError):  # a folder that can be read only
            os.utime(file)  # it is used now: `_prune` of another process leaves it
        return hashlib.sha256(file.read_bytes()).hexdigest() == beside.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError):
        return False


def _store(file: Path, binary: bytes) -> None:
    """Write a file and its hash, each in one piece; whatever is there goes."""
    digest = hashlib.sha256(binary).hexdigest().encode("ascii")
    for path, content in ((file, binary), (file.with_suffix(".sha256"), digest)):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.is_symlink() or not path.is_file():
            path.unlink(missing_ok=True)
        with replaced(path) as partial:
            partial.touch(0o600)
            partial.write_bytes(content)
