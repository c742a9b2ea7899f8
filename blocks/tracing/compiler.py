"""Compilation of C sources to a shared library with an installed compiler."""

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

from trussflow.blocks.support.processes import end
from trussflow.blocks.support.progress import map_counted
from trussflow.blocks.support.temporary_folders import process_folder, with_place
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
"""Compiler options.

Only `codegen` fuses multiplications and additions, so that results do not depend on the compiler and the
processor. ``-ffast-math`` is not used, as checks for NaN must work. Without ``-fno-builtin-atan``, GCC
replaces sin(atan(x)) by x / sqrt(x**2 + 1), and returns 1 if x is NaN.
"""

WEB_FLAGS = (
    *("-O2", "-msimd128", "-ffp-contract=off"),
    *("-fno-math-errno", "-fno-builtin-atan"),
)
"""Compiler options for WebAssembly; reasons as for `FLAGS`. It has no fused multiplication and addition."""

WEB_STACK = 8 << 20
"""Size of the stack of a WebAssembly module [B], as usual on Linux; programs have their work arrays there."""

NO_WEB_COMPILER = (
    "no compiler for WebAssembly was found: 'pip install ziglang' installs one; or set WASM_CC to the command "
    "of a clang with the libraries of WASI"
)

NO_COMPILER = "no C compiler was found; install gcc or clang, or 'pip install ziglang'"

LARGE_SOURCE = 2 << 20
"""Size of C code above which it is compiled with -O1 [B].

The result is equal bit by bit. A flight with 10 MB of code is as fast as with -O2, and compiled in 60 % of
the time; the plant, 1 MB, is 20 % slower.
"""

COMPILE_TIMEOUT = 1800.0
"""Longest time of a compilation [s]; the largest models take some minutes."""

VERSION_TIMEOUT = 60.0
"""Longest time of a query of the compiler version [s]."""


@functools.cache
def find_compiler() -> tuple[str, ...] | None:
    """Return the command of a C compiler: $CC, cc, gcc, clang, or the ziglang package."""
    return _found(os.environ.get("CC", ""), "cc", "gcc", "clang")


def _found(*commands: str) -> tuple[str, ...] | None:
    """Return the first of the `commands` whose program exists, or that of the ziglang package."""
    for command in map(str.split, commands):
        if command and shutil.which(command[0]):
            return tuple(command)
    try:
        import ziglang  # noqa: F401
    except ImportError:
        return None
    return (sys.executable, "-m", "ziglang", "cc")


def options_for(flags: Sequence[str], size: int) -> tuple[str, ...]:
    """Return compiler options for code of a `size` [B]: `flags`, what its size needs, and $TRUSSFLOW_CFLAGS."""
    level = ("-O1",) if size > LARGE_SOURCE else ()
    return (*flags, *level, *os.environ.get("TRUSSFLOW_CFLAGS", "").split())


def compile_library(
    content: str, sources: Callable[[], Sequence[str]], functions: Sequence[str] = ()
) -> Path:
    """Compile C sources to a shared library that can be loaded, or find it in the cache.

    The cache key is a hash of the content, the compiler and the options.

    Parameters
    ----------
    content : str
        Text that determines the sources.
    sources : callable
        Returns the C files; called only if the cache has no valid library.
    functions : sequence of str
        Names of the functions that the library must define.

    Returns
    -------
    pathlib.Path
        The library.

    Raises
    ------
    CompilationError
        If there is no compiler, it fails, or the library cannot be stored or loaded.
    """
    compiler = find_compiler()
    if compiler is None:
        raise CompilationError(NO_COMPILER)

    def load(library: Path) -> None:
        # Loading is the check: a damaged or foreign file fails here and is built again.
        loaded = ctypes.CDLL(str(library))
        for name in functions:
            getattr(loaded, name)

    def build() -> bytes:
        files = sources()
        return _build(compiler, files, options_for(FLAGS, sum(map(len, files))))

    try:
        key = "\0".join((*identity(compiler), *options_for(FLAGS, 0), content))
        return cached(key, ".so", build, load)
    except OSError as error:
        raise CompilationError(f"cannot compile {with_place(error)}") from error


def compile_web_module(
    content: str, sources: Callable[[], Sequence[str]], functions: Sequence[str]
) -> bytes:
    """Compile C sources to a WebAssembly module without imports, or find it in the cache.

    Parameters
    ----------
    content, sources, functions
        As for `compile_library`; the functions are exported, with ``memory`` and ``__heap_base``.

    Returns
    -------
    bytes
        The module.

    Raises
    ------
    CompilationError
        If there is no compiler, it fails, or the module cannot be stored.
    """
    found = _found(os.environ.get("WASM_CC", ""))
    if found is None:
        raise CompilationError(NO_WEB_COMPILER)
    compiler = (*found, "-target", "wasm32-wasi")
    linking = [
        *("-mexec-model=reactor", "-s", f"-Wl,-z,stack-size={WEB_STACK}"),
        *(f"-Wl,--export={name}" for name in (*functions, "__heap_base")),
    ]
    try:
        key = "\0".join((*identity(compiler), *WEB_FLAGS, *linking, content))
        return cached(
            key, ".wasm", lambda: _build(compiler, sources(), WEB_FLAGS, linking)
        ).read_bytes()
    except OSError as error:
        raise CompilationError(f"cannot compile {with_place(error)}") from error


@functools.cache
def identity(compiler: tuple[str, ...]) -> tuple[str, ...]:
    """Return texts that identify the compiler, its version, and the processor.

    Parameters
    ----------
    compiler : tuple of str
        The command.
    """
    return (
        *compiler,
        _run([*compiler, "--version"], VERSION_TIMEOUT).stdout,
        _processor(),
    )


def compiled(command: Sequence[str], file: Path) -> Path:
    """Run a compiler that writes a file; return the file.

    Parameters
    ----------
    command : sequence of str
        The command without the output option.
    file : pathlib.Path
        The output file.

    Raises
    ------
    CompilationError
        If there is no such program, it fails, exceeds the timeout, or writes no file.
    """
    ended = _run([*command, "-o", str(file)], COMPILE_TIMEOUT)
    if ended.returncode or not file.is_file():
        said = (
            ended.stderr.strip()[-4000:]
            or f"it ended with code {ended.returncode} and without a message"
        )
        raise CompilationError(f"{' '.join(command[:4])} failed:\n{said}")
    return file


def _run(command: list[str], seconds: float) -> subprocess.CompletedProcess[str]:
    """Run a compiler in the temporary folder of this process; return its exit code and output."""
    pipe, folder = subprocess.PIPE, process_folder()
    try:
        # In its own process group, so that its child processes are stopped with it on Ctrl-C or timeout.
        process = subprocess.Popen(
            command, stdout=pipe, stderr=pipe, cwd=folder, process_group=0
        )
    except OSError as error:
        raise CompilationError(
            f"the compiler {command[0]} cannot be run: {error}"
        ) from error
    with process:
        try:
            said = [
                text.decode("utf-8", "replace")
                for text in process.communicate(timeout=seconds)
            ]
        except subprocess.TimeoutExpired:
            end(process)
            raise CompilationError(
                f"{' '.join(command[:4])} did not end within {seconds:g} s"
            ) from None
        # Ctrl-C included: the compiler must not survive this process.
        except BaseException:
            end(process)
            raise
    return subprocess.CompletedProcess(command, process.returncode, *said)


def _processor() -> str:
    """Return the processor features, on which the result of ``-march=native`` depends."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        import platform

        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")


def lanes() -> int:
    """Return the number of vector lanes [-]: 8 with AVX-512, else 4 (AVX2, or two vectors of two numbers)."""
    return 8 if " avx512f" in _processor() else 4


def _build(
    compiler: tuple[str, ...],
    sources: Sequence[str],
    flags: Sequence[str],
    linking: Sequence[str] = ("-shared",),
) -> bytes:
    """Compile files in parallel in a temporary folder, and return the bytes of the library.

    The options `flags` are those of the compiler, and `linking` those of the linker.
    """
    with tempfile.TemporaryDirectory(dir=process_folder()) as folder:

        def part(number: int) -> Path:
            file = Path(folder) / f"part{number}.c"
            file.write_text(sources[number], encoding="utf-8")
            return compiled(
                [*compiler, *flags, "-c", str(file)], file.with_suffix(".o")
            )

        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            # Threads wait for compilers; this thread takes results, reports progress.
            made = pool.map(part, range(len(sources)))
            parts = map_counted("compiling", lambda _: next(made), sources)
        return compiled(
            [*compiler, *linking, *map(str, parts), "-lm"], Path(folder) / "plan.so"
        ).read_bytes()
