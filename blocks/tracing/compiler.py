"""Compiling C to a shared library, cached on disk by content."""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import platformdirs

from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.files import replaced

FLAGS = (
    "-O2",
    "-march=native",
    "-ffp-contract=fast",
    "-fno-math-errno",
    "-fno-semantic-interposition",
    "-fPIC",
)
"""Fused multiply-add is wanted; ``-ffast-math`` is not: NaN checks must work."""

HINT = (
    "no C compiler was found: simulations run in CasADi's interpreter, some forty times slower. "
    "Install gcc or clang, or 'pip install ziglang'"
)


class CompilationError(TrussflowError):
    """The C compiler failed on generated code."""


@functools.cache
def find_compiler() -> tuple[str, ...] | None:
    """Return the command of a C compiler: $CC, cc, gcc, clang, or the ziglang package."""
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        if name and shutil.which(name.split()[0]):
            return tuple(name.split())
    try:
        import ziglang  # noqa: F401
    except ImportError:
        return None
    return (sys.executable, "-m", "ziglang", "cc")


def available() -> bool:
    """Tell whether there is a C compiler; if not, give one hint per process."""
    if find_compiler() is None:
        _hint()
        return False
    return True


@functools.cache
def _hint() -> None:
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and str(frame.f_globals["__name__"]).startswith(
        ("trussflow.", "functools")
    ):
        level, frame = level + 1, frame.f_back
    warnings.warn(HINT, RuntimeWarning, stacklevel=level)


def cache_folder() -> Path:
    """Return where compiled code is kept: $TRUSSFLOW_CACHE, else the user's cache folder."""
    given = os.environ.get("TRUSSFLOW_CACHE")
    return Path(given) if given else Path(platformdirs.user_cache_dir("trussflow"))


def compile_library(content: str, sources: Callable[[], Sequence[str]]) -> Path:
    """Compile C source to a shared library, or find it in the cache.

    The name in the cache is a hash of the content, the compiler and the flags. A library is
    stored next to its own hash and is compiled again if that does not match, so a damaged
    file does no harm; it is moved into place in one piece, so two processes may compile at
    once; a cache folder that cannot be written is replaced by a temporary one.

    Parameters
    ----------
    content : str
        What the sources are made from; equal contents have equal sources.
    sources : callable
        Returns the C files; called only if nothing suitable is in the cache.

    Returns
    -------
    pathlib.Path
        The library.

    Raises
    ------
    CompilationError
        If the compiler fails; its message is part of the error.
    """
    compiler = find_compiler()
    if compiler is None:
        raise CompilationError(HINT)
    key = "\0".join((*identity(compiler), *FLAGS, content))
    return cached(key, ".so", lambda: _build(compiler, sources()))


def cached(content: str, suffix: str, build: Callable[[], bytes]) -> Path:
    """Return the file in the cache that was built from this content, or build it.

    Parameters
    ----------
    content : str
        What the file is made from, the tools included.
    suffix : str
        Ending of its name.
    build : callable
        Returns the bytes of the file; called only if nothing suitable is in the cache.
    """
    key = hashlib.sha256(content.encode()).hexdigest()
    file = cache_folder() / f"{key[:32]}{suffix}"
    spare = _temporary_folder() / file.name
    for found in (file, spare):
        if _is_intact(found):
            return found
    binary = build()
    try:
        return _store(file, binary)
    except OSError:
        return _store(spare, binary)


@functools.cache
def identity(compiler: tuple[str, ...]) -> tuple[str, ...]:
    """Return what distinguishes this compiler and processor from others.

    Parameters
    ----------
    compiler : tuple of str
        The command.
    """
    return (*compiler, run([*compiler, "--version"]).stdout, _processor())


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a compiler and return what it said; what it leaves beside it is thrown away.

    Raises
    ------
    CompilationError
        If there is no such program.
    """
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=_temporary_folder())
    except OSError as error:
        raise CompilationError(f"the compiler {command[0]} cannot be run: {error}") from error


def _processor() -> str:
    """Return what ``-march=native`` depends on."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        import platform

        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")


@functools.cache
def _temporary_folder() -> Path:
    """Return a folder of this process, for when the cache cannot be written."""
    import atexit

    folder = tempfile.mkdtemp(prefix="trussflow-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _is_intact(library: Path) -> bool:
    """Tell whether a cached library is there and matches the hash stored beside it."""
    try:
        expected = library.with_suffix(".sha256").read_text(encoding="ascii")
        return hashlib.sha256(library.read_bytes()).hexdigest() == expected
    except (OSError, UnicodeDecodeError):
        return False


def _build(compiler: tuple[str, ...], sources: Sequence[str]) -> bytes:
    """Compile files at the same time, in a temporary folder, and return the library's bytes."""
    with tempfile.TemporaryDirectory(prefix="trussflow-") as folder:
        library = Path(folder) / "plan.so"
        commands = []
        for i, source in enumerate(sources):
            file = Path(folder) / f"part{i}.c"
            file.write_text(source, encoding="utf-8")
            commands.append([*compiler, *FLAGS, "-c", str(file), "-o", str(file.with_suffix(".o"))])
        link = [*compiler, "-shared", *(c[-1] for c in commands), "-o", str(library), "-lm"]
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            runs = list(pool.map(run, commands))
        for ended in [*runs, *([] if any(r.returncode for r in runs) else [run(link)])]:
            if ended.returncode:
                raise CompilationError(f"{' '.join(compiler)} failed:\n{ended.stderr[-4000:]}")
        return library.read_bytes()


def _store(library: Path, binary: bytes) -> Path:
    """Write a library and its hash, each in one piece."""
    library.parent.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(binary).hexdigest().encode("ascii")
    for path, content in ((library, binary), (library.with_suffix(".sha256"), digest)):
        with replaced(path) as partial:
            partial.write_bytes(content)
    return library
