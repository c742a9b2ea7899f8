"""Export of blocks and diagrams as FMUs or plain C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from trussflow.blocks.framework.block import Block
from trussflow.blocks.simulation.adaptive import METHODS
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.temporary_folders import with_place
from trussflow.blocks.support.validation import by_name, one_of, shown, yes_or_no
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.export_interface import (
    DEFAULT_TOLERANCE,
    ExportInterface,
)
from trussflow.fmu.exporting.description.model_description import FMI_VERSIONS
from trussflow.fmu.exporting.native.package import native_files
from trussflow.fmu.exporting.packing import check_writable, write, written
from trussflow.fmu.exporting.plain_c.plain_files import plain_files
from trussflow.fmu.exporting.python.python_files import python_files

SOLVERS = {
    "native": ("rk4", *METHODS),
    "python": (*FIXED_STEP, *METHODS),
    "c": ("rk4",),
}
"""Solvers by kind of export."""

ABOUT_ATTRIBUTES = (
    "author",
    "copyright",
    "description",
    "generationDateAndTime",
    "license",
    "version",
)
"""Attributes of the model description that the user may set."""


@interruptible()
def export(
    item: Block,
    path: str | Path,
    *,
    kind: str = "native",
    version: str = "2.0",
    arrays: bool = True,
    step: float = 1e-3,
    stop_time: float = 10.0,
    tolerance: float = DEFAULT_TOLERANCE,
    parameters: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    platforms: str | Sequence[str] | None = None,
    solver: str = "rk4",
    about: Mapping[str, str] | None = None,
) -> Path:
    """Write a block or diagram as an FMU or as plain C.

    A native FMU offers model exchange and co-simulation and needs no Python on the target. Its
    co-simulation uses fixed steps of the classical Runge-Kutta method, or variable steps. In model
    exchange, sample instants and jumps of signals are time events, and events of blocks have event
    indicators. A kink of a signal that is not an event is left to the importer's step size control.
    In co-simulation, events are located inside a step; an FMI 3 importer that allows early return
    gets control there.

    A Python FMU offers co-simulation. It may contain Python blocks, but no imported FMUs. It
    contains a copy of the item with its author's code. The target needs Python with this version of
    trussflow and the packages listed in ``resources/requirements.txt`` of the FMU; a C compiler
    makes it faster.

    Plain C is a source and a header without FMI and without memory allocation, for a flight
    computer or a microcontroller. Its functions initialize, step, set each input and parameter,
    and get each output. The results equal those of `Session`. States whose initial value is a
    number can be set until the first step, including those of sampled blocks. A controller can thus
    start from the state of another one. The code is C99; if a diagram repeats equations
    (`repeated`), it needs the vector extension of GCC and Clang.

    Parameters
    ----------
    item : Block
        A block, whose ports become variables, or a diagram, whose exposed ports become variables.
    path : path
        File to write; if the export fails, it is not changed. The stem of a C source, such as
        ``controller.c``, is the prefix of its functions.
    kind : str
        ``"native"``, ``"python"`` or ``"c"``.
    version : str
        Version of FMI: ``"2.0"`` (one variable per scalar) or ``"3.0"`` (array variables).
    arrays : bool
        Whether FMI 3.0 uses array variables; else one variable per scalar, as OMSimulator needs.
    step : float
        Fixed step of the solver [s]; sample times must be multiples of it.
    stop_time, tolerance : float
        Stop time [s] and relative tolerance [-] of the default experiment.
    parameters : mapping, optional
        Values of parameters by ``"block.parameter"``, or by ``"parameter"`` for a single block [units
        as declared]; the importer may change them. `check_parameters` is Python code: a Python FMU
        rejects a step with invalid values, but native FMUs and plain C do not check them.
    start : mapping, optional
        Start values of inputs by name [units of the ports]; zero by default.
    platforms : str or sequence of str, optional
        Target platforms of a native FMU by FMI 3's names, such as ``"x86_64-windows"``, or
        ``"all"``; by default this platform. Other platforms need the package ziglang. An empty
        tuple exports the sources only. A Python FMU always has the binaries of pythonfmu.
    solver : str
        Solver of co-simulation, as for `Session`; plain C has rk4 only. Variable steps of native
        FMUs have the relative tolerance of the importer, otherwise `tolerance`, and a hundredth of
        it as absolute tolerance. They start anew in each communication step.
    about : mapping of str to str, optional
        Attributes of the model description: author, copyright, description, generationDateAndTime,
        license, version. The default description is the first line of the block's docstring.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ExportError
        If the item cannot be exported with these options; the message names the remedy.
    DiagramError
        If the diagram cannot be built.
    """
    one_of("kind of FMU", kind, tuple(SOLVERS), ExportError)
    one_of("FMI version", version, FMI_VERSIONS, ExportError)
    one_of(f"solver for {kind=}:", solver, SOLVERS[kind], ExportError)
    if kind == "c" and (version != "2.0" or platforms is not None):
        raise ExportError(
            "plain C has no FMI version and is compiled by the user; leave out version and platforms"
        )
    if kind == "python" and platforms is not None:
        raise ExportError(
            "an FMU of kind 'python' contains the binaries of pythonfmu; leave out "
            "platforms, or export with kind='native'"
        )
    yes_or_no("export", "arrays", arrays)
    # First, because tracing and compiling can take minutes.
    target = check_writable(path)
    interface = ExportInterface.of(
        item,
        step=step,
        stop_time=stop_time,
        tolerance=tolerance,
        parameters=parameters,
        start=start,
        solver=solver,
    )
    for name, text in (about := by_name("about", about)).items():
        one_of("attribute of an FMU", name, ABOUT_ATTRIBUTES, ExportError)
        if not isinstance(text, str):
            raise ExportError(
                f"cannot export '{item.name}': its {name} must be text, not {shown(text)}"
            )
    interface = replace(interface, about=about)
    if not arrays and version == "3.0":
        interface = replace(interface, variables=interface.variables.scalarized())
    if kind == "c":
        for file, text in plain_files(interface, target).items():
            with written(file) as partial:
                partial.write_text(text, encoding="utf-8", newline="\n")
        return target
    try:
        if kind == "python":
            files = python_files(item, interface, version)
        else:
            files = native_files(interface, version, platforms)
    except (CompilationError, OSError) as error:
        raise ExportError(f"cannot export to '{target}' {with_place(error)}") from error
    write(target, files)
    return target
