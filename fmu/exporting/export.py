"""Export: from a block or diagram to an FMU file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.interrupts import interruptible
from trussflow.blocks.framework.temporary import with_place
from trussflow.blocks.framework.validation import by_name, one_of, shown, yes_or_no
from trussflow.blocks.simulation.adaptive import METHODS
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.export_interface import TOLERANCE, ExportInterface
from trussflow.fmu.exporting.description.model_description import VERSIONS
from trussflow.fmu.exporting.native.package import native_files
from trussflow.fmu.exporting.packing import check_writable, write, written
from trussflow.fmu.exporting.plain_c.plain_files import plain_files
from trussflow.fmu.exporting.python.python_files import python_files

KINDS = ("native", "python", "c")

ABOUT = ("author", "copyright", "description", "generationDateAndTime", "license", "version")
"""Attributes of the model description that are the user's."""


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
    tolerance: float = TOLERANCE,
    parameters: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    platforms: str | Sequence[str] | None = None,
    solver: str = "rk4",
    about: Mapping[str, str] | None = None,
) -> Path:
    """Write a block, or what a diagram exposes, as an FMU.

    A native FMU offers model exchange and co-simulation, the latter with fixed steps of the
    classical Runge-Kutta method inside; it needs no Python where it runs. In model exchange,
    sample times and times at which signals jump are time events, and events of blocks have indicators;
    where a signal kinks without being an event, the importer's step control has to cope. In
    co-simulation, events are located inside a step; FMI 3 importers that allow it get the step back there.

    A Python FMU offers co-simulation; it may hold Python blocks (but no imported FMUs), and takes
    along a copy of the item with the code of its author, and this package under another name.
    Where it runs it needs Python with the libraries that ``resources/requirements.txt`` in it
    lists; a C compiler makes it faster.

    Plain C is a source and a header without FMI and without allocation, for a flight loop or a
    microcontroller: functions that initialize, step, set each input and parameter, and get each
    output, with the numbers of `Session`. States that start at a number of their own can be set until
    the first step, those of sampled blocks too, so that a law begins where another one ends. It is
    C99; where a diagram repeats equations (`repeated`), it needs the vector extension of GCC and Clang.

    Parameters
    ----------
    item : Block
        A block, all of whose ports become variables, or a diagram, whose exposed ports do.
    path : path
        File to write; it appears whole or not at all. The name of a C source, such as
        ``controller.c``, begins the names of its functions.
    kind : str
        ``"native"``, ``"python"`` or ``"c"``.
    version : str
        Version of FMI: ``"2.0"`` (one variable per scalar) or ``"3.0"`` (array variables).
    arrays : bool
        Whether FMI 3.0 has array variables; else one per scalar, which importers such as OMSimulator need.
    step : float
        Step of the internal solver [s]; sample times are multiples of it.
    stop_time, tolerance : float
        End [s] and relative tolerance [-] of the default experiment.
    parameters : mapping, optional
        Values of parameters by ``"block.parameter"``, or ``"parameter"`` where a single block is
        exported [units as declared]; the importer may still change them. What `check_parameters` refuses
        is Python code: a Python FMU refuses to step with such values, native FMUs and plain C do not look.
    start : mapping, optional
        Start values of inputs by name [units of the ports]; zero by default.
    platforms : str or sequence of str, optional
        What a native FMU is compiled for, by FMI 3's names such as ``"x86_64-windows"``, or
        ``"all"``; by default this platform. Other ones need the package ziglang. With none
        (``()``), it holds the sources only. A Python FMU always has the binaries of pythonfmu.
    solver : str
        Solver inside a Python FMU, as for `Session`.
    about : mapping of str to str, optional
        Author, copyright, description, generationDateAndTime, license and version, for the model
        description; the description is by default the first line of the block's docstring.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ExportError
        If it cannot be exported as asked; the message says why and what to do.
    DiagramError
        If the diagram cannot be built.
    """
    one_of("kind of FMU", kind, KINDS, ExportError)
    one_of("FMI version", version, tuple(VERSIONS), ExportError)
    one_of("solver", solver, (*FIXED_STEP, *METHODS), ExportError)
    if kind != "python" and solver != "rk4":
        what = "a native FMU" if kind == "native" else "plain C"
        raise ExportError(f"{what} has the solver rk4 inside, not {solver!r}; try kind='python'")
    if kind == "c" and (version != "2.0" or platforms is not None):
        raise ExportError(
            "plain C has no FMI version and is compiled by you; leave out version and platforms"
        )
    if kind == "python" and platforms is not None:
        raise ExportError(
            "an FMU of kind 'python' has the binaries that pythonfmu brings along; leave out "
            "platforms, or export with kind='native'"
        )
    yes_or_no("export", "arrays", arrays)
    target = check_writable(path)
    interface = ExportInterface.of(
        item, step=step, stop_time=stop_time, tolerance=tolerance, parameters=parameters, start=start
    )
    for name, text in (about := by_name("about", about)).items():
        one_of("attribute of an FMU", name, ABOUT, ExportError)
        if not isinstance(text, str):
            raise ExportError(f"cannot export '{item.name}': its {name} must be text, not {shown(text)}")
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
            files = python_files(item, interface, version, solver)
        else:
            files = native_files(interface, version, platforms)
    except (CompilationError, OSError) as error:
        raise ExportError(f"cannot export to '{target}' {with_place(error)}") from error
    write(target, files)
    return target
