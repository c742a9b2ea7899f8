"""Loops in place of code written out, for elements of a result that are computed alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from trussflow.blocks.tracing.instructions import Instruction, is_time, needed, number
from trussflow.blocks.tracing.operations import OF_PRODUCTS, Numbers

LEAST = 8
"""Elements that a loop is worth."""

PERIODS = range(1, 9)
"""Distances between the elements of a loop: equal blocks of several states, side by side, make as many."""

LARGEST = 2048
"""Operations of one element at most, those that wait for operands included: a row of a matrix is long."""

FEW = 64
"""The same where some of them are for other elements, too: these compute them again."""

NOTHING = Instruction(ca.OP_CONST, ())

COMMON = 4
"""A value that more operations take is computed once, before the loops."""

Leaf = tuple[int, int] | tuple[float] | int
"""What an element is computed from: argument and element, a constant, or the number of an instruction."""


@dataclass(frozen=True, slots=True)
class Element:
    """How one element of a result is computed.

    Attributes
    ----------
    output : int
        The instruction that writes it.
    form : tuple
        Its operations with their operands: numbers of earlier operations, or -1 - s for leaf s. The last is
        its value; an element without any is leaf 0.
    leaves : tuple of Leaf
        Each as often as it is taken.
    """

    output: int
    form: tuple[tuple[int, tuple[int, ...]], ...]
    leaves: tuple[Leaf, ...]


def rolled(
    instructions: list[Instruction], read: Sequence[str], target: int, shared: str, numbers: Numbers
) -> tuple[list[Instruction], list[str], int]:
    """Return what is left to be written out, the C of loops, and how many numbers these share with it.

    The loops stand behind and write ``result``. Their operations are the same, on numbers that are side by
    side, or as far apart: of vectors of thousands of elements, of a thousand equal blocks. Written out, they
    take compilers minutes. What many elements take alike, such as a norm, is written out, once, as an output
    with the number behind the result's.

    Parameters
    ----------
    instructions : list of Instruction
        Of a program.
    read : sequence of str
        What elements of its arguments are called, with ``{}`` for their number.
    target : int
        The number of its result among the outputs.
    shared : str
        What elements of the array are called in which such values are, likewise.
    numbers : Numbers
        What it computes with.
    """
    elements = _elements(instructions, target)
    loops, done, places = list[str](), set[int](), dict[int, int]()
    for start in sorted(elements):
        if elements[start].output in done:
            continue
        runs = ((_run(elements, start, n, done), n) for n in PERIODS)
        run, period = next((found for found in runs if found[0] >= LEAST), (1, 1))
        if run == 1:
            continue
        each = [elements[start + period * i] for i in range(run)]
        for leaf in each[0].leaves:
            if isinstance(leaf, int):
                places.setdefault(leaf, len(places))
        done |= {element.output for element in each}
        names = {k: shared.format(place) for k, place in places.items()}
        loops += ["  {", *_loop(each, read, names, f"result[{start} + {period} * i]", numbers), "  }"]
    left = [NOTHING if k in done else one for k, one in enumerate(instructions)]
    left += [Instruction(ca.OP_OUTPUT, (k,), (target + 1, place)) for k, place in places.items()]
    return needed(left) if done else instructions, loops, len(places)


def _elements(instructions: Sequence[Instruction], target: int) -> dict[int, Element]:
    """Return how the elements of a result are computed, those that are few operations."""
    uses = [0] * len(instructions)
    for one in instructions:
        for operand in one.operands:
            uses[operand] += 1
    given = (ca.OP_INPUT, ca.OP_CONST)
    leaves = [one.operation in given or n > COMMON for one, n in zip(instructions, uses, strict=True)]
    found: dict[int, Element] = {}
    for k, one in enumerate(instructions):
        if one.operation != ca.OP_OUTPUT or one.place[0] != target:
            continue
        if instructions[one.operands[0]].operation == ca.OP_INPUT:
            continue  # moved, see codegen
        element = _expanded(k, instructions, uses, leaves)
        if element is not None:
            found[one.place[1]] = element
    return found


def _expanded(
    output: int, instructions: Sequence[Instruction], uses: Sequence[int], is_leaf: Sequence[bool]
) -> Element | None:
    """Return the element that the `output` writes, None if it is too many operations."""

    def called(k: int) -> int:
        """Return how the value of instruction `k` is called; that of a leaf has another name each time."""
        one = instructions[k]
        if not is_leaf[k]:
            return known[k]
        if one.operation == ca.OP_INPUT:
            leaves.append((one.place[0], one.place[1]))
        else:
            leaves.append((one.constant,) if one.operation == ca.OP_CONST else k)
        return -len(leaves)

    form, leaves, known = list[tuple[int, tuple[int, ...]]](), list[Leaf](), dict[int, int]()
    root = instructions[output].operands[0]
    waiting = [] if is_leaf[root] else [root]  # no recursion: sums of hundreds of terms are as deep
    most = LARGEST
    while waiting:
        k = waiting[-1]
        before = [o for o in instructions[k].operands if not is_leaf[o] and o not in known]
        if not before:
            waiting.pop()
            if k not in known:
                form.append((instructions[k].operation, tuple(map(called, instructions[k].operands))))
                known[k] = len(form) - 1
        waiting += before
        if uses[k] > 1:
            most = FEW
        if len(waiting) + len(form) > most:
            return None
    if not form:
        called(root)
    return Element(output, tuple(form), tuple(leaves))


def _run(elements: Mapping[int, Element], start: int, period: int, done: set[int]) -> int:
    """Return how many elements from the first on, each so far behind the other, are computed alike."""
    first, second = elements[start], elements.get(start + period)
    if second is None or second.form != first.form:
        return 1
    steps = [_step(a, b) for a, b in zip(first.leaves, second.leaves, strict=True)]
    length = 1
    while (other := elements.get(start + period * length)) is not None:
        if other.output in done or other.form != first.form:
            break
        if not all(
            _is_at(a, step, length, b) for a, step, b in zip(first.leaves, steps, other.leaves, strict=True)
        ):
            break
        length += 1
    return length


def _step(first: Leaf, second: Leaf) -> int:
    """Return how far the leaf of the next element is from that of the first."""
    alike = isinstance(first, tuple) and isinstance(second, tuple) and len(first) == len(second) == 2
    return second[1] - first[1] if alike else 0  # type: ignore[index,misc]


def _is_at(first: Leaf, step: int, i: int, leaf: Leaf) -> bool:
    """Tell whether a `leaf` is that of element `i`, if those of one and the next are a `step` apart."""
    if isinstance(first, tuple) and isinstance(leaf, tuple) and len(first) == len(leaf):
        return len(first) == 1 or (leaf[0] == first[0] and leaf[1] == first[1] + step * i)  # type: ignore[misc]
    return first == leaf


def _loop(
    each: Sequence[Element], read: Sequence[str], known: Mapping[int, str], result: str, numbers: Numbers
) -> list[str]:
    """Return the C of a loop over elements that are computed alike; what is `known` has a name."""
    tables, names = list[str](), list[str]()
    for s, first in enumerate(each[0].leaves):
        if isinstance(first, int):
            names.append(known[first])
        elif len(first) == 2:
            step = _step(first, each[1].leaves[s])
            text = read[first[0]].format(f"{first[1]} + {step} * i" if step else first[1])
            names.append(numbers.of_one(text) if is_time(text) else text)
        else:
            constants = [number(element.leaves[s][0]) for element in each]  # type: ignore[index]
            if len({*constants}) > 1:
                tables.append(f"    static const double c{s}[] = {{{', '.join(constants)}}};")
            names.append(numbers.of_one(f"c{s}[i]" if len({*constants}) > 1 else constants[0]))
    values = list[str]()
    sums = {f"e{k}" for k, (operation, _) in enumerate(each[0].form) if operation in OF_PRODUCTS}
    for k, (operation, operands) in enumerate(each[0].form):
        given = [f"e{o}" if o >= 0 else names[-1 - o] for o in operands]
        values.append(f"      const {numbers.type} e{k} = {numbers.computed(operation, given, sums)};")
    last = f"e{len(values) - 1}" if values else names[0]
    head = f"    for (int i = 0; i < {len(each)}; ++i) {{"
    return [*tables, head, *values, f"      {result} = {last};", "    }"]
