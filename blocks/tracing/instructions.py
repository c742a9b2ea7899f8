"""Instructions of a program, and their C expressions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import isfinite, isnan
from typing import NamedTuple

import casadi as ca

from trussflow.blocks.tracing.operations import FUSED_OPERATIONS, Numbers

TIME_NAME = "t"
"""Name of the time argument in C, which all lanes share."""


class Instruction(NamedTuple):
    """One instruction of an SX function, in static single assignment form.

    Attributes
    ----------
    operation : int
        CasADi's number of the operation.
    operands : tuple of int
        Indices of the instructions whose results are its operands.
    place : tuple of int
        Argument and element that an input reads or an output writes.
    constant : float
        Value of a constant [any].
    """

    operation: int
    operands: tuple[int, ...]
    place: tuple[int, ...] = ()
    constant: float = 0.0


def instructions_of(function: ca.Function) -> list[Instruction]:
    """Return the instructions of an SX function."""
    found: list[Instruction] = []
    holder: dict[int, int] = {}  # work element -> instruction that wrote it last
    # CasADi reuses work elements. With the last writer of each, operands become
    # instructions. Each instruction is appended once, so that its index is k.
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            found.append(Instruction(operation, (), tuple(inputs)))
        elif operation == ca.OP_CONST:
            found.append(
                Instruction(operation, (), (), function.instruction_constant(k))
            )
        elif operation == ca.OP_OUTPUT:
            found.append(Instruction(operation, (holder[inputs[0]],), tuple(outputs)))
            continue
        else:
            found.append(Instruction(operation, tuple(holder[i] for i in inputs)))
        holder[outputs[0]] = k
    return found


def fused(instructions: list[Instruction]) -> list[Instruction]:
    """Fuse products with the sums that use them (fused multiply-add, rounded once); drop the products.

    Only a product with a single use is fused, so that ``u - f(u)`` is exactly 0 where f returns u, as in
    NumPy. The compiler must not fuse: its choice would depend on the processor. Squares are not fused: a
    square that overflows is infinite, and ``2 x - x**2`` is then NaN, as in NumPy.

    Parameters
    ----------
    instructions : list of Instruction
        Instructions, each after its operands.
    """
    uses = Counter(operand for each in instructions for operand in each.operands)
    result: list[Instruction] = []
    for instruction in instructions:
        for place, operand in enumerate(instruction.operands):
            # With two products, the first is fused and the second is rounded by itself.
            operation = FUSED_OPERATIONS.get((instruction.operation, place))
            if (
                operation
                and instructions[operand].operation == ca.OP_MUL
                and uses[operand] == 1
            ):
                operands = (
                    *instructions[operand].operands,
                    instruction.operands[1 - place],
                )
                instruction = instruction._replace(
                    operation=operation, operands=operands
                )
                break
        result.append(instruction)
    return needed(result)


def needed(instructions: list[Instruction]) -> list[Instruction]:
    """Return the instructions on which outputs depend (dead code elimination).

    Parameters
    ----------
    instructions : list of Instruction
        Instructions, each after its operands.
    """
    used: set[int] = set()
    for k in reversed(range(len(instructions))):
        if k in used or instructions[k].operation == ca.OP_OUTPUT:
            used |= {k, *instructions[k].operands}
    new = {k: number for number, k in enumerate(sorted(used))}
    if len(new) == len(instructions):
        return instructions
    return [
        instructions[k]._replace(
            operands=tuple(new[o] for o in instructions[k].operands)
        )
        for k in new
    ]


def number(value: float) -> str:
    """Return the C literal of a `value` [any]."""
    if isnan(value):
        return "NAN"
    if not isfinite(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    # `repr` has the shortest digits that give the same number. Parentheses, as "a--1.0"
    # is no valid C.
    return repr(value) if value >= 0 else f"({value!r})"


def named(
    k: int, instruction: Instruction, read: Sequence[str], numbers: Numbers
) -> str:
    """Return the C expression of the value of an instruction: an argument, a literal, or a variable.

    Parameters
    ----------
    k : int
        Index of the instruction.
    instruction : Instruction
        The instruction.
    read : sequence of str
        C expressions of an element of each argument, with ``{}`` for its index.
    numbers : Numbers
        Type of numbers; time is always a scalar.
    """
    if instruction.operation == ca.OP_INPUT:
        argument, element = instruction.place
        text = read[argument].format(element)
        return numbers.of_one(text) if is_time(text) else text
    return (
        numbers.of_one(number(instruction.constant))
        if instruction.operation == ca.OP_CONST
        else f"v{k}"
    )


def is_time(name: str) -> bool:
    """Return whether the C expression `name` is an element of the time argument."""
    return name.startswith(f"{TIME_NAME}[")
