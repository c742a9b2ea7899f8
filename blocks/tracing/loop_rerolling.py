"""Loop rerolling: C loops over elements of a result that have the same operations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from trussflow.blocks.tracing.instructions import Instruction, is_time, needed, number
from trussflow.blocks.tracing.operations import FUSED_FORMULAS, Numbers

MIN_LOOP_ELEMENTS = 8
"""Smallest number of elements for which a loop is generated."""

LOOP_PERIODS = range(1, 9)
"""Strides between the elements of a loop; equal blocks with n states need the stride n."""

MAX_ELEMENT_OPERATIONS = 2048
"""Largest number of operations of one element, those under expansion included; matrix rows are long."""

MAX_SHARED_OPERATIONS = 64
"""Largest number of operations of an element that shares some with others, which compute them again."""

EMPTY_INSTRUCTION = Instruction(ca.OP_CONST, ())

MAX_REPEATED_USES = 4
"""Largest number of uses of a value that loops compute again; other values are computed before the loops."""

Leaf = tuple[int, int, float]
"""Source of an operand: argument and index, `CONSTANT_VALUE`, or `SHARED_VALUE` and an instruction; constant value."""

CONSTANT_VALUE = -1
"""First number of an operand that is a constant."""

SHARED_VALUE = -2
"""First number of an operand that is the value of an instruction outside the loops."""


@dataclass(frozen=True, slots=True)
class Element:
    """Expression of one element of a result.

    Attributes
    ----------
    output : int
        Index of the instruction that writes the element.
    form : tuple
        Operations with their operands: indices of earlier operations, or -1 - s for leaf s. The last
        operation gives the value; without operations, leaf 0 does.
    leaves : tuple of Leaf
        Source of each use of a leaf.
    """

    output: int
    form: tuple[tuple[int, tuple[int, ...]], ...]
    leaves: tuple[Leaf, ...]


def rerolled(
    instructions: list[Instruction],
    read: Sequence[str],
    target: int,
    shared: str,
    numbers: Numbers,
) -> tuple[list[Instruction], list[str], int]:
    """Return the remaining instructions, the C code of the loops, and the number of values shared by both.

    The loops follow the remaining instructions and write ``result``. The elements of a loop have the same
    operations, on operands with a constant stride: vectors of thousands of elements, or a thousand equal
    blocks. Without loops, compilers would take minutes. A value that many elements use, such as a norm, is
    computed once, as an output with the index after that of the result.

    Parameters
    ----------
    instructions : list of Instruction
        Instructions of a program.
    read : sequence of str
        C expressions of an element of each argument, with ``{}`` for its index.
    target : int
        Index of the result among the outputs.
    shared : str
        C expression of an element of the array of shared values, with ``{}`` for its index.
    numbers : Numbers
        Type of numbers.
    """
    elements = _elements(instructions, target)
    loops, done, places = list[str](), set[int](), dict[int, int]()
    for start in sorted(elements):
        if elements[start].output in done:
            continue
        # The smallest stride with a long enough run wins; larger ones are not searched.
        runs = ((_run(elements, start, n, done), n) for n in LOOP_PERIODS)
        run, period = next(
            (found for found in runs if found[0] >= MIN_LOOP_ELEMENTS), (1, 1)
        )
        if run == 1:
            continue
        each = [elements[start + period * i] for i in range(run)]
        for source, k, _ in each[0].leaves:
            if source == SHARED_VALUE:
                places.setdefault(k, len(places))
        done |= {element.output for element in each}
        names = {k: shared.format(place) for k, place in places.items()}
        loops += [
            "  {",
            *_loop(each, read, names, f"result[{start} + {period} * i]", numbers),
            "  }",
        ]
    left = [
        EMPTY_INSTRUCTION if k in done else one for k, one in enumerate(instructions)
    ]
    left += [
        Instruction(ca.OP_OUTPUT, (k,), (target + 1, place))
        for k, place in places.items()
    ]
    return needed(left) if done else instructions, loops, len(places)


def _elements(instructions: Sequence[Instruction], target: int) -> dict[int, Element]:
    """Return the expressions of the elements of a result, for elements with few operations."""
    uses = Counter(operand for one in instructions for operand in one.operands)
    leaves = [
        one.operation in (ca.OP_INPUT, ca.OP_CONST) or uses[k] > MAX_REPEATED_USES
        for k, one in enumerate(instructions)
    ]
    found: dict[int, Element] = {}
    for k, one in enumerate(instructions):
        if one.operation != ca.OP_OUTPUT or one.place[0] != target:
            continue
        if instructions[one.operands[0]].operation == ca.OP_INPUT:
            continue  # copied by `_moved` in codegen
        element = _expanded(k, instructions, uses, leaves)
        if element is not None:
            found[one.place[1]] = element
    return found


def _expanded(
    output: int,
    instructions: Sequence[Instruction],
    uses: Mapping[int, int],
    is_leaf: Sequence[bool],
) -> Element | None:
    """Return the element that the `output` writes, None if it has too many operations."""

    def called(k: int) -> int:
        """Return the operand number of instruction `k`; a leaf gets a new number for each use."""
        one = instructions[k]
        if not is_leaf[k]:
            return known[k]
        source, index = SHARED_VALUE, k
        if one.operation == ca.OP_INPUT:
            source, index = one.place
        elif one.operation == ca.OP_CONST:
            source, index = CONSTANT_VALUE, 0
        leaves.append((source, index, one.constant))
        return -len(leaves)

    form, known = list[tuple[int, tuple[int, ...]]](), dict[int, int]()
    leaves = list[Leaf]()
    root = instructions[output].operands[0]
    # A stack, as sums of hundreds of terms exceed the recursion limit.
    waiting = [] if is_leaf[root] else [root]
    most = MAX_ELEMENT_OPERATIONS
    while waiting:
        k = waiting[-1]
        before = [
            o for o in instructions[k].operands if not is_leaf[o] and o not in known
        ]
        if not before:
            waiting.pop()
            if k not in known:
                form.append(
                    (
                        instructions[k].operation,
                        tuple(map(called, instructions[k].operands)),
                    )
                )
                known[k] = len(form) - 1
        waiting += before
        if uses[k] > 1:
            most = MAX_SHARED_OPERATIONS
        if len(waiting) + len(form) > most:
            return None
    if not form:
        called(root)
    return Element(output, tuple(form), tuple(leaves))


def _run(
    elements: Mapping[int, Element], start: int, period: int, done: set[int]
) -> int:
    """Return the number of elements, from the first on at a stride of `period`, with the same operations."""
    first, second = elements[start], elements.get(start + period)
    if second is None or second.form != first.form:
        return 1
    leaves = np.array(first.leaves)[:, :2]
    steps = np.array(second.leaves)[:, :2] - leaves
    # Operands of one place must come from one array. A shared value is the same in all
    # elements, as its index is not an index of an array.
    if steps[:, 0].any() or steps[leaves[:, 0] == SHARED_VALUE].any():
        return 1
    length = 1
    while (other := elements.get(start + period * length)) is not None:
        if other.output in done or other.form != first.form:
            break
        places = np.array(other.leaves)[:, :2]
        if not np.array_equal(places, leaves + length * steps):
            break
        length += 1
    return length


def _loop(
    each: Sequence[Element],
    read: Sequence[str],
    known: Mapping[int, str],
    result: str,
    numbers: Numbers,
) -> list[str]:
    """Return the C code of a loop over elements with the same operations; `known` names shared values."""
    tables, names = list[str](), list[str]()
    for s, (source, index, _) in enumerate(each[0].leaves):
        if source == SHARED_VALUE:
            names.append(known[index])
        elif source == CONSTANT_VALUE:
            # Constants that differ between the elements are read from a table.
            constants = [number(element.leaves[s][2]) for element in each]
            if len({*constants}) > 1:
                tables.append(
                    f"    static const double c{s}[] = {{{', '.join(constants)}}};"
                )
            names.append(
                numbers.of_one(f"c{s}[i]" if len({*constants}) > 1 else constants[0])
            )
        else:
            step = each[1].leaves[s][1] - index
            text = read[source].format(f"{index} + {step} * i" if step else index)
            names.append(numbers.of_one(text) if is_time(text) else text)
    values = list[str]()
    sums = {
        f"e{k}"
        for k, (operation, _) in enumerate(each[0].form)
        if operation in FUSED_FORMULAS
    }
    for k, (operation, operands) in enumerate(each[0].form):
        given = [f"e{o}" if o >= 0 else names[-1 - o] for o in operands]
        values.append(
            f"      const {numbers.type} e{k} = {numbers.computed(operation, given, sums)};"
        )
    last = f"e{len(values) - 1}" if values else names[0]
    head = f"    for (int i = 0; i < {len(each)}; ++i) {{"
    return [*tables, head, *values, f"      {result} = {last};", "    }"]
