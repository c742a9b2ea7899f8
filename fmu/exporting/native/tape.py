"""The tape: all operations behind a vector as tables, from which C computes derivatives.

A compiled derivative of a large system is several times the size of the system itself; the
tables take no time to compile.
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca

from trussflow.blocks.tracing.instructions import instructions_of
from trussflow.blocks.tracing.operations import FORMULAS
from trussflow.blocks.tracing.program import Program
from trussflow.fmu.errors import ExportError

PREFIX = "OP_"
OPERATIONS = {
    int(getattr(ca, name)): name.removeprefix(PREFIX)
    for name in dir(ca)
    if name.startswith(PREFIX) and (getattr(ca, name) in FORMULAS or name in ("OP_INPUT", "OP_CONST"))
}
"""Names, in C, of the operations that occur."""


def operation_names() -> str:
    """Return the C enumeration of all operations."""
    return f"enum {{ {', '.join(f'TF_OP_{name}' for name in OPERATIONS.values())} }};"


def tape(program: Program, name: str, rates: int) -> str:
    """Return the C tables of a program.

    Parameters
    ----------
    program : Program
        What they compute.
    name : str
        Beginning of the tables' names.
    rates : int
        How many of the first results are the derivatives; the part of the tape that they need
        comes first.

    Raises
    ------
    ExportError
        If the program calls a function that has no expression.
    """
    without = [
        call.kernel
        for call in program.calls
        if call.kernel.source and (call.kernel.near is None or program.name == "initialization")
    ]
    if called := [kernel.function.name() for kernel in without]:
        raise ExportError(
            f"cannot export derivatives of {', '.join(called)}, which an output or a rate of this item "
            "depends on at all times: sample the block that computes it, or export with kind='c' or 'python'"
        )
    function = program.expanded
    starts = [sum(i.numel() for i in program.inputs[:k]) for k in range(len(program.inputs))]
    numbers = {operation: i for i, operation in enumerate(OPERATIONS)}
    operations: list[int] = []
    first: list[int] = []
    second: list[int] = []
    constants: list[float] = []
    rows = [0] * program.size
    place: list[int] = []  # of each instruction on the tape
    for instruction in instructions_of(function):
        if instruction.operation == ca.OP_OUTPUT:
            rows[instruction.place[1]] = place[instruction.operands[0]]
            place.append(-1)
            continue
        place.append(len(operations))
        operations.append(numbers[instruction.operation])
        if instruction.operation == ca.OP_INPUT:
            argument, element = instruction.place
            first.append(starts[argument] + element)
            second.append(0)
        elif instruction.operation == ca.OP_CONST:
            first.append(len(constants))
            second.append(0)
            constants.append(instruction.constant)
        else:
            operands = [place[i] for i in instruction.operands]
            first.append(operands[0])
            second.append(operands[-1])
    length = name.upper()
    return "\n".join(
        [
            f"#define {length} {len(operations)}",
            f"#define {length}_RATES {1 + max(rows[:rates], default=-1)}",
            table("unsigned char", f"{name}_operation", operations),
            table("unsigned", f"{name}_a", first),
            table("unsigned", f"{name}_b", second),
            table("double", f"{name}_constants", constants),
            table("unsigned", f"{name}_rows", rows),
        ]
    )


def table(kind: str, name: str, values: Iterable[float | str]) -> str:
    """Return a C table; an empty one gets an element that nothing reads.

    Parameters
    ----------
    kind, name : str
        Type of the elements and name of the table.
    values : iterable of number or str
        The elements [any].
    """
    texts = [value if isinstance(value, str) else _number(value) for value in values] or ["0"]
    lines = (", ".join(texts[i : i + 16]) for i in range(0, len(texts), 16))
    return f"static const {kind} {name}[] = {{\n" + ",\n".join(lines) + "};"


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    special = {"nan": "NAN", "inf": "INFINITY", "-inf": "-INFINITY"}
    return special.get(repr(value), repr(value))
