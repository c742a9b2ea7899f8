"""Compilation of the C source of an FMU to shared libraries for one or more platforms."""

from __future__ import annotations

import os
import platform as this_platform
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import fmpy

from trussflow.blocks.support.progress import map_counted
from trussflow.blocks.support.temporary_folders import process_folder
from trussflow.blocks.support.validation import one_of
from trussflow.blocks.tracing.compile_cache import cached
from trussflow.blocks.tracing.compiler import (
    compiled,
    find_compiler,
    identity,
    options_for,
)
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.native.source import Source

COMPILER_FLAGS = (
    *("-O2", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off"),
    *("-fno-math-errno", "-fno-builtin-atan", "-w"),
)
"""Compiler flags of the simulation, for bit-equal results, without ``-march=native``, because an FMU
also runs on other processors."""

FAST_FLAGS = ("-mavx2", "-mfma")
"""Flags for the fast variant of the equations on x86-64, which is selected at run time."""


SYSTEMS = {
    "linux": (".so", "linux64", "linux-gnu"),
    "windows": (".dll", "win64", "windows-gnu"),
    "darwin": (".dylib", "darwin64", "macos"),
}
"""Suffix of shared libraries, folder in FMI 2.0, and name for ziglang, by system."""


@dataclass(frozen=True, slots=True)
class Platform:
    """A target platform of an FMU.

    Attributes
    ----------
    system, processor : str
        Names of FMI 3: ``"linux"``, ``"windows"`` or ``"darwin"``; ``"x86_64"`` or ``"aarch64"``.
    """

    system: str
    processor: str

    @property
    def name(self) -> str:
        """Name of the platform in FMI 3, such as ``"x86_64-linux"``."""
        return f"{self.processor}-{self.system}"

    @property
    def suffix(self) -> str:
        """Suffix of a shared library."""
        return SYSTEMS[self.system][0]

    def folder(self, version: str, among: Sequence[Platform]) -> str:
        """Return the folder of the binary within ``binaries/``.

        FMI 2 has no names for ARM processors; importers on ARM use the folder of the system. That
        folder is used unless the FMU also has a binary for x86-64.

        Parameters
        ----------
        version : str
            ``"2.0"`` or ``"3.0"``.
        among : sequence of Platform
            All platforms of this FMU.
        """
        if version == "3.0":
            return self.name
        taken = self.processor != "x86_64" and Platform(self.system, "x86_64") in among
        return self.name if taken else SYSTEMS[self.system][1]


KNOWN_PLATFORMS = (
    Platform("linux", "x86_64"),
    Platform("linux", "aarch64"),
    Platform("windows", "x86_64"),
    Platform("darwin", "x86_64"),
    Platform("darwin", "aarch64"),
)


def here() -> Platform:
    """Return the platform that this program runs on."""
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    processor = this_platform.machine().lower()
    return Platform(
        system, {"amd64": "x86_64", "arm64": "aarch64"}.get(processor, processor)
    )


def chosen(names: str | Sequence[str] | None) -> tuple[Platform, ...]:
    """Return platforms by their names in FMI 3; None is this platform, ``"all"`` all platforms.

    Parameters
    ----------
    names : str, sequence of str or None
        The name or names.

    Raises
    ------
    ExportError
        If a name is unknown.
    """
    if names is None:
        return (here(),)
    given: Any = names
    wanted = [*given] if isinstance(given, list | tuple | set) else [given]
    known = {p.name: p for p in (*KNOWN_PLATFORMS, here())}
    for name in wanted:
        one_of("platform", name, [*known, "all"], ExportError)
    if "all" in wanted:
        return KNOWN_PLATFORMS
    return tuple(dict.fromkeys(known[name] for name in wanted))


def compile_binary(source: Source, target: Platform) -> bytes:
    """Return the shared library of an FMU.

    Parameters
    ----------
    source : Source
        Its C files.
    target : Platform
        The target platform.

    Raises
    ------
    ExportError
        If there is no compiler for that platform.
    CompilationError
        If the compilation fails.
    """
    command = _compiler(target)
    model = ("-DTF_VARIANT=_ordinary",)
    headers = Path(str(fmpy.__file__)).parent / "c-code"
    wrapper = ("-DTF_SEPARATE", "-I", str(headers))
    jobs = [(source.model, model, "model.c"), (source.wrapper, wrapper, "all.c")]
    if target.processor == "x86_64":
        jobs = [
            # -O1: without fast vector instructions, the vectorization of -O2 makes the code slower.
            (source.model, ("-O1", *model), "model.c"),
            (source.model, (*FAST_FLAGS, "-DTF_VARIANT=_fast"), "model.c"),
            (source.wrapper, (*wrapper, "-DTF_FAST"), "all.c"),
        ]
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        # The pool compiles ahead, in order; this thread only counts the results.
        made = pool.map(lambda job: _object(command, *job), jobs)
        objects = map_counted(
            f"compiling for {target.name}", lambda _: next(made), jobs
        )
    with tempfile.TemporaryDirectory(dir=process_folder()) as folder:
        library = Path(folder) / f"model{target.suffix}"
        # The linker of macOS has no -s; its system library includes libm.
        others = [] if target.system == "darwin" else ["-s", "-lm"]
        return compiled(
            [*command, "-shared", *map(str, objects), *others], library
        ).read_bytes()


def _compiler(target: Platform) -> tuple[str, ...]:
    """Return the command of a compiler for a platform.

    Raises
    ------
    ExportError
        If no compiler is found.
    """
    name = f"{target.processor}-{SYSTEMS[target.system][2]}"
    zig = (sys.executable, "-m", "ziglang", "cc", "-target", name)
    if target != here():
        if find_spec("ziglang") is None:
            raise ExportError(
                f"cannot compile for {target.name} on {here().name}: 'pip install ziglang' installs "
                "a compiler for all platforms"
            )
        return zig
    command = find_compiler()
    if command is None:
        raise ExportError(
            "cannot compile: no C compiler was found; install gcc or clang, or 'pip install "
            "ziglang', or export the sources alone with platforms=()"
        )
    return zig if "ziglang" in command else command


def _object(
    command: tuple[str, ...], text: str, flags: tuple[str, ...], name: str
) -> Path:
    """Return the object file of a C file, compiled or from the cache."""
    flags = options_for((*COMPILER_FLAGS, *flags), len(text))
    key = "\0".join((*identity(command), *flags, text))

    def build() -> bytes:
        with tempfile.TemporaryDirectory(dir=process_folder()) as folder:
            file = Path(folder) / name
            file.write_text(text, encoding="utf-8")
            return compiled(
                [*command, *flags, "-c", str(file)], file.with_suffix(".o")
            ).read_bytes()

    return cached(key, ".o", build)
