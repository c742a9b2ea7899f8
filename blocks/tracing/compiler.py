"""Compiling C to a shared library: by whatever compiler there is, which may fail in any way."""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from trussflow.blocks.framework.processes import end
from trussflow.blocks.framework.telling import all_counted
from trussflow.blocks.framework.temporary import process_folder, with_place
from trussflow.blocks.tracing.compile_cache import CompilationError, cached

FLAGS = (
    "-O2",
    "-march=native",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-builtin-atan",
    "-fno-semantic-interposition",
    "-fPIC",
)
"""Multiplication and addition are fused where `codegen` writes so, and nowhere else: compilers that choose
do so anew for each processor. ``-ffast-math`` is not wanted: NaN checks must work. GCC without errno writes
sin(atan(x)) as x / sqrt(x**2 + 1), and 1 if x is NaN, unless it does not know what atan is."""

NO_COMPILER = "no C compiler was found; install gcc or clang, or 'pip install ziglang'"

TIME_LIMIT = 1800.0
"""Time [s] after which a compiler is taken to never end; the largest models take some minutes."""

ANSWER_LIMIT = 60.0
"""The same for the question which version it is [s]."""


@functools.cache
def find_compiler() -> tuple[str, ...] | None:
    """Return the command of a C compiler: $CC, cc, gcc, clang, or the ziglang package."""
    for command in (os.environ.get("CC", "").split(), ["cc"], ["gcc"], ["clang"]):
        if command and shutil.which(command[0]):
            return tuple(command)
    try:
        import ziglang  # noqa: F401
    except ImportError:
        return None
    return (sys.executable, "-m", "ziglang", "cc")


def compile_library(
    content: str, sources: Callable[[], Sequence[str]], functions: Sequence[str] = ()
) -> Path:
    """Compile C source to a shared library that can be loaded, or find it in the cache.

    Its name in the cache is a hash of the content, the compiler and the flags.

    Parameters
    ----------
    content : str
        What the sources are made from; equal contents have equal sources.
    sources : callable
        Returns the C files; called only if nothing suitable is in the cache.
    functions : sequence of str
        Names of functions that it must have.

    Returns
    -------
    pathlib.Path
        The library.

    Raises
    ------
    CompilationError
        If there is no compiler, it fails, its message being part of the error, or what it makes
        cannot be stored or loaded.
    """
    compiler = find_compiler()
    if compiler is None:
        raise CompilationError(NO_COMPILER)

    def load(library: Path) -> None:
        loaded = ctypes.CDLL(str(library))
        for name in functions:
            getattr(loaded, name)

    try:
        key = "\0".join((*identity(compiler), *FLAGS, content))
        return cached(key, ".so", lambda: _build(compiler, sources()), load)
    except OSError as error:
        raise CompilationError(f"cannot compile {with_place(error)}") from error


@functools.cache
def identity(compiler: tuple[str, ...]) -> tuple[str, ...]:
    """Return what distinguishes this compiler and processor from others.

    Parameters
    ----------
    compiler : tuple of str
        The command.
    """
    return (*compiler, _run([*compiler, "--version"], ANSWER_LIMIT).stdout, _processor())


def compiled(command: Sequence[str], file: Path) -> Path:
    """Run a compiler that is to write a file; return the file.

    Parameters
    ----------
    command : sequence of str
        The command, but for where to write.
    file : pathlib.Path
        The file.

    Raises
    ------
    CompilationError
        If there is no such program, it fails, does not end, or writes nothing.
    """
    ended = _run([*command, "-o", str(file)], TIME_LIMIT)
    if ended.returncode or not file.is_file():
        said = ended.stderr.strip()[-4000:] or f"it said nothing, and ended with code {ended.returncode}"
        raise CompilationError(f"{' '.join(command[:4])} failed:\n{said}")
    return file


def _run(command: list[str], seconds: float) -> subprocess.CompletedProcess[str]:
    """Run a compiler and return what it said; what it leaves beside it is thrown away."""
    pipe, folder = subprocess.PIPE, process_folder()
    try:
        # A group of its own: what it starts goes with it if it is stopped, by Ctrl-C or the limit.
        process = subprocess.Popen(command, stdout=pipe, stderr=pipe, cwd=folder, process_group=0)
    except OSError as error:
        raise CompilationError(f"the compiler {command[0]} cannot be run: {error}") from error
    with process:
        try:
            said = [text.decode("utf-8", "replace") for text in process.communicate(timeout=seconds)]
        except subprocess.TimeoutExpired:
            end(process)
            raise CompilationError(f"{' '.join(command[:4])} did not end within {seconds:g} s") from None
        except BaseException:
            end(process)
            raise
    return subprocess.CompletedProcess(command, process.returncode, *said)


def _processor() -> str:
    """Return what ``-march=native`` depends on."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        import platform

        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")


def lanes() -> int:
    """Return how many numbers are computed at once [-]: 8 with AVX-512, else 4, by AVX2 or two by two."""
    return 8 if " avx512f" in _processor() else 4


def _build(compiler: tuple[str, ...], sources: Sequence[str]) -> bytes:
    """Compile files at the same time, in a temporary folder, and return the library's bytes."""
    with tempfile.TemporaryDirectory(dir=process_folder()) as folder:

        def part(number: int) -> Path:
            file = Path(folder) / f"part{number}.c"
            file.write_text(sources[number], encoding="utf-8")
            return compiled([*compiler, *FLAGS, "-c", str(file)], file.with_suffix(".o"))

        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            made = pool.map(part, range(len(sources)))
            parts = all_counted("compiling", lambda _: next(made), sources)
        return compiled(
            [*compiler, "-shared", *map(str, parts), "-lm"], Path(folder) / "plan.so"
        ).read_bytes()
