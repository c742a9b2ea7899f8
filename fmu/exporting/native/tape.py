"""Tape for algorithmic differentiation in C: all operations of a program as tables.

The compiled derivative of a large system is several times larger than the system itself; tables
add almost no compile time.
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

from trussflow.blocks.tracing.instructions import instructions_of
from trussflow.blocks.tracing.operations import FORMULAS
from trussflow.blocks.tracing.program import Program
from trussflow.fmu.errors import ExportError

OPERATION_PREFIX = "OP_"
OPERATION_NAMES = {
    int(getattr(ca, name)): name.removeprefix(OPERATION_PREFIX)
    for name in dir(ca)
    if name.startswith(OPERATION_PREFIX)
    and (getattr(ca, name) in FORMULAS or name in ("OP_INPUT", "OP_CONST"))
}
"""Names in C of the operations, by CasADi's number."""


def operation_names() -> str:
    """Return the C enumeration of all operations."""
    return (
        f"enum {{ {', '.join(f'TF_OP_{name}' for name in OPERATION_NAMES.values())} }};"
    )


def tape(program: Program, name: str, rates: int) -> str:
    """Return the C tables of a program.

    Parameters
    ----------
    program : Program
        The program.
    name : str
        Prefix of the tables' names.
    rates : int
        Number of leading results that are state derivatives; their part of the tape comes first.

    Raises
    ------
    ExportError
        If the program calls a function without a symbolic expression.
    """
    called = [
        call.kernel.function.name()
        for call in program.calls
        if call.kernel.source
        and (call.kernel.near is None or program.name == "initialization")
    ]
    if called:
        raise ExportError(
            f"cannot export derivatives of {', '.join(called)}, which an output or a rate of this item "
            "depends on at all times: sample the block that computes it, or export with kind='c' or 'python'"
        )
    function = program.expanded
    starts = np.cumsum([0, *(i.numel() for i in program.inputs)])
    numbers = {operation: i for i, operation in enumerate(OPERATION_NAMES)}
    entries: list[tuple[int, int, int]] = []  # operation and two operands
    constants: list[float] = []
    rows = [0] * program.size
    place: list[int] = []  # position of each instruction on the tape
    for instruction in instructions_of(function):
        if instruction.operation == ca.OP_OUTPUT:
            rows[instruction.place[1]] = place[instruction.operands[0]]
            place.append(-1)
            continue
        place.append(len(entries))
        operands = [place[i] for i in instruction.operands] or [0]
        if instruction.operation == ca.OP_INPUT:
            argument, element = instruction.place
            operands = [starts[argument] + element, 0]
        elif instruction.operation == ca.OP_CONST:
            operands = [len(constants), 0]
            constants.append(instruction.constant)
        # A unary operation has its operand twice; its second derivative is zero.
        entries.append((numbers[instruction.operation], operands[0], operands[-1]))
    # `reshape` gives three columns also if there are no entries.
    operations, first, second = np.array(entries, dtype=int).reshape(-1, 3).T.tolist()
    length = name.upper()
    return "\n".join(
        [
            f"#define {length} {len(entries)}",
            f"#define {length}_RATES {1 + max(rows[:rates], default=-1)}",
            table("unsigned char", f"{name}_operation", operations),
            table("unsigned", f"{name}_a", first),
            table("unsigned", f"{name}_b", second),
            table("double", f"{name}_constants", constants),
            table("unsigned", f"{name}_rows", rows),
        ]
    )


def table(kind: str, name: str, values: Iterable[float | str]) -> str:
    """Return a C table; an empty table gets one unused element, as C requires.

    Parameters
    ----------
    kind, name : str
        Type of the elements and name of the table.
    values : iterable of number or str
        The elements [any].
    """
    texts = [
        value if isinstance(value, str) else _number(value) for value in values
    ] or ["0"]
    lines = (", ".join(texts[i : i + 16]) for i in range(0, len(texts), 16))
    return f"static const {kind} {name}[] = {{\n" + ",\n".join(lines) + "};"


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    special = {"nan": "NAN", "inf": "INFINITY", "-inf": "-INFINITY"}
    return special.get(repr(value), repr(value))
