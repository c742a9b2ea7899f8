"""C code of programs: straight-line code with kernel calls in between."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from importlib.resources import files
from itertools import groupby

import casadi as ca

from trussflow.blocks.tracing.instructions import FORMULAS, Instruction, fused, instructions_of, named, number
from trussflow.blocks.tracing.operations import ALL_LANES, OF_PRODUCTS, ONE_LANE
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.rolling import rolled
from trussflow.blocks.tracing.tracing import KERNEL, KernelCall

ARGUMENTS = ("t", "x", "d", "p")

PARAMETERS = ", ".join(f"const double* restrict {a}" for a in ARGUMENTS)

OWN_NAME = "trussflow"

_WORK = """\
  double work[{size}] __attribute__((aligned(64)));
  double* restrict w = work;
  __asm__("" : "+r"(w));"""
"""The array w. Its alignment is hidden: GCC 12 that knows it copies 64 bytes to where only 32 are aligned."""

LARGE = 3000
"""Instructions from which on a program is compiled by itself."""

PIECE = 2000
"""Instructions in one C function at most: twice as many take compilers more than twice as long."""


def c_sources(programs: Sequence[Program]) -> list[str]:
    """Return C sources of programs with the stepping loop behind them.

    Large programs get a file each, so that they can be compiled at the same time; small ones
    share one file with the loop, so that they can be inlined.

    Parameters
    ----------
    programs : sequence of Program
        The first one is the derivative; all take (t, x, d, p).
    """
    names = [p.name for p in programs]
    macros = {
        "TF_X": programs[0].inputs[1].numel(),
        "TF_D": programs[0].inputs[2].numel(),
        "TF_OUTPUTS": int("outputs" in names),
        "TF_SAMPLES": "".join(f", tf_run_{n}" for n in names if n.startswith("sample_")),
        "TF_PROGRAMS": ", ".join(f"tf_run_{n}" for n in names),
    }
    defined = [f"#define {name} {value}" for name, value in (macros | event_sizes(programs)).items()]
    large = [p for p in programs[1:] if p.graph.n_instructions() > LARGE]
    beside = [p for p in programs if p not in large]
    declared = [f"{_head(p.name)};" for p in large]
    main = [
        lanes(),
        *defined,
        *declared,
        *c_functions(beside, "static "),
        fixed_step(),
        events(),
        _file("driver.c"),
    ]
    others = [[lanes(), *c_functions([p], "")] for p in large]
    return ["\n".join(parts) for parts in [main, *others]]


def lanes() -> str:
    """Return the C declarations that the functions of programs need before them."""
    return fma() + _file("lanes.h")


def fma() -> str:
    """Return what of these is enough if there are no kernels."""
    return _file("fma.h")


def fixed_step() -> str:
    """Return the C functions that take one fixed step; TF_X has to be defined before them."""
    return _file("fixed_step.h")


def events() -> str:
    """Return the C functions that take a step with its events; see there what has to be defined before."""
    return _file("events.h")


def event_sizes(programs: Iterable[Program]) -> dict[str, int]:
    """Return how many events, modes and guesses there are, by the names of their macros, for `events`."""
    sizes = {program.name: program.size for program in programs}
    modes = sizes["on_event"] - sizes["derivative"] if "on_event" in sizes else 0
    return {"TF_EVENTS": sizes.get("indicators", 0), "TF_MODES": modes, "TF_LOOPS": sizes.get("guesses", 0)}


def c_functions(programs: Sequence[Program], linkage: str) -> list[str]:
    """Return the C functions of programs and of the kernels they call.

    Parameters
    ----------
    programs : sequence of Program
        All take (t, x, d, p).
    linkage : str
        What to put before each, such as ``"static "``.
    """
    kernels: dict[int, str] = {}
    parts: list[str] = []
    for call in (call for program in programs for call in program.calls):
        if id(call) not in kernels:
            kernels[id(call)] = f"tf_kernel_{len(kernels)}"
            parts.append(_kernel(call, kernels[id(call)]))
    for program in programs:
        *pieces, whole = _program(program, kernels)
        parts += [*pieces, linkage + whole]
    return parts


def _head(name: str) -> str:
    """Return the head of the C function of a program."""
    return f"void tf_run_{name}({PARAMETERS}, double* restrict result)"


def content(programs: Sequence[Program]) -> str:
    """Return what the C source of programs is made from, quicker than the source itself.

    Parameters
    ----------
    programs : sequence of Program
        As for `c_sources`.
    """
    made_by = ("codegen.py", "instructions.py", "rolling.py", "operations.py")
    made_of = ("fma.h", "lanes.h", "fixed_step.h", "events.h", "driver.c")
    return "\0".join([*(program.code for program in programs), *map(_file, made_by + made_of)])


@cache
def _file(name: str) -> str:
    """Return a file of this folder, the same whatever name the package was given in an FMU."""
    text = files("trussflow.blocks.tracing").joinpath(name).read_text(encoding="utf-8")
    return text.replace(f"{__name__.partition('.')[0]}.", f"{OWN_NAME}.")


def _program(program: Program, kernels: dict[int, str]) -> list[str]:
    """Return the C functions of a program, its own the last; a long one calls functions of its pieces."""
    # In w are the arguments and results of the kernels, and what one piece computes for another.
    read, written, size = list(ARGUMENTS), list[str](), 0
    for call in program.calls:
        for names, symbols in ((written, call.inputs), (read, call.symbols)):
            names.append(f"(w + {size})")
            size += -(-symbols.numel() // 8) * 8  # whole lines of 64 bytes
    written += ["result", f"(w + {size})"]
    found = rolled(fused(instructions_of(program.graph)), read, len(program.calls), written[-1])
    instructions, loops, common = found
    size += common
    apart = len(instructions) > PIECE
    length = PIECE if apart else max(len(instructions), 1)
    stages = _stages(instructions, len(program.calls))
    pieces = [stage[i : i + length] for stage in stages for i in range(0, len(stage), length)]
    bodies, shared = _bodies(instructions, pieces, read, written, first=size if apart else None)

    functions: list[str] = []
    size = max(size + shared, 1)
    lines = [_WORK.format(size=size)] if apart or program.calls or common else []
    for i, stage in enumerate(stages):
        for _ in range(0, len(stage), length):
            body = bodies.pop(0)
            if apart:
                name = f"tf_{program.name}_{len(functions)}"
                head = f"void {name}({PARAMETERS}, double* restrict result, double* restrict w)"
                functions.append("\n".join([f"static __attribute__((noinline)) {head} {{", *body, "}", ""]))
                body = [f"  {name}({', '.join(ARGUMENTS)}, result, w);"]
            lines += body
        if i < len(program.calls):
            lines.append(f"  {kernels[id(program.calls[i])]}({written[i]}, {read[len(ARGUMENTS) + i]});")
    return [*functions, "\n".join([f"{_head(program.name)} {{", *lines, *loops, "}", ""])]


def _bodies(
    instructions: Sequence[Instruction],
    pieces: Sequence[Sequence[int]],
    read: Sequence[str],
    written: Sequence[str],
    first: int | None,
) -> tuple[list[list[str]], int]:
    """Return the statements of each piece, and how many elements of w they share.

    These begin at the `first`; with None all pieces are in one function and share its variables.
    """
    places, shared = ({}, 0) if first is None else _shared(instructions, pieces, first)
    text = [named(k, instruction, read) for k, instruction in enumerate(instructions)]
    bodies: list[list[str]] = []
    for piece in pieces:
        here, body, moves = set(piece), list[str](), list[tuple[int, ...]]()
        for k in piece:
            instruction = instructions[k]
            operands = [
                f"w[{places[o]}]" if o in places and o not in here else text[o] for o in instruction.operands
            ]
            if instruction.operation == ca.OP_OUTPUT:
                source = instructions[instruction.operands[0]]
                if source.operation == ca.OP_INPUT:
                    moves.append((*instruction.place, *source.place))
                else:
                    body.append(f"  {written[instruction.place[0]]}[{instruction.place[1]}] = {operands[0]};")
            elif instruction.operation in FORMULAS:
                body.append(
                    f"  const double v{k} = {FORMULAS[instruction.operation].format(*operands, w='')};"
                )
            if k in places:
                body.append(f"  w[{places[k]}] = v{k};")
        bodies.append(body + _moved(moves, written, read))
    return bodies, shared


def straight_line(function: ca.Function, read: Sequence[str], written: Sequence[str]) -> str:
    """Return the C statements of an SX `function`; its arguments and results are called `read`, `written`."""
    instructions = fused(instructions_of(function))
    bodies, _ = _bodies(instructions, [range(len(instructions))], read, written, first=None)
    return "\n".join(bodies[0])


def _shared(
    instructions: Sequence[Instruction], pieces: Sequence[Sequence[int]], first: int
) -> tuple[dict[int, int], int]:
    """Return where in w the values are that a later piece needs, from the first on, and how many places."""
    last = {o: n for n, piece in enumerate(pieces) for k in piece for o in instructions[k].operands}
    places: dict[int, int] = {}
    free: list[int] = []  # where nothing is needed any more
    size = 0
    for n, piece in enumerate(pieces):
        free += [place for k, place in places.items() if last[k] == n - 1]
        for k in piece:
            if last.get(k, n) > n and instructions[k].operation not in (ca.OP_INPUT, ca.OP_CONST):
                if not free:
                    free.append(first + size)
                    size += 1
                places[k] = free.pop()
    return places, size


def _stages(instructions: Sequence[Instruction], calls: int) -> list[list[int]]:
    """Return what is computed before each kernel and after the last: where it is first needed."""
    stage = [calls] * len(instructions)
    for k in reversed(range(len(instructions))):
        instruction = instructions[k]
        if instruction.operation == ca.OP_OUTPUT:
            stage[k] = min(instruction.place[0], calls)
        for operand in instruction.operands:
            stage[operand] = min(stage[operand], stage[k])
    return [[k for k, s in enumerate(stage) if s == i] for i in range(calls + 1)]


def _moved(moves: Sequence[tuple[int, ...]], targets: Sequence[str], arguments: Sequence[str]) -> list[str]:
    """Return C that moves numbers: those side by side, where from and where to, in one loop.

    Thousands of statements take the compiler minutes, and the processor as long as what they are for.
    """
    lines = []

    def run(numbered: tuple[int, tuple[int, ...]]) -> tuple[int, ...]:
        number, (target, to, argument, source) = numbered
        return target, argument, to - number, source - number

    for _, group in groupby(enumerate(sorted(moves)), run):
        each = [move for _, move in group]
        target, to, argument, source = each[0]
        lines.append(
            f"  for (int i = 0; i < {len(each)}; ++i) "
            f"{targets[target]}[{to} + i] = {arguments[argument]}[{source} + i];"
        )
    return lines


def _kernel(call: KernelCall, name: str) -> str:
    """Return the C function of a kernel, which takes as many instances at once as lanes."""
    if call.kernel.source:
        return call.kernel.source.replace(KERNEL, name)
    count = call.inputs.size2()
    width = 4 if count >= 4 else 2
    lanes, vectors = f"tf_lanes{width}", ALL_LANES | OF_PRODUCTS
    lines: list[str] = []
    text: list[str] = []
    for k, instruction in enumerate(fused(instructions_of(call.kernel.function))):
        operands = [text[i] for i in instruction.operands]
        text.append(f"v{k}")
        if instruction.operation == ca.OP_INPUT:
            value = f"*(const {lanes}*)(a + {instruction.place[1] * count})"
        elif instruction.operation == ca.OP_CONST:
            value = f"({lanes}){{0}} + {number(instruction.constant)}"
        elif instruction.operation == ca.OP_OUTPUT:
            lines.append(f"    *({lanes}*)(r + {instruction.place[1] * count}) = {operands[0]};")
            continue
        elif instruction.operation in vectors:
            value = vectors[instruction.operation].format(*operands, w=f"tf_{width}_")
        else:
            one = ONE_LANE[instruction.operation]
            each = (one.format(*(f"{o}[{i}]" for o in operands)) for i in range(width))
            value = f"({lanes}){{{', '.join(each)}}}"
        lines.append(f"    const {lanes} v{k} = {value};")
    # The last group overlaps the one before where the lanes do not divide the instances.
    starts = [min(g, count - width) for g in range(0, count, width)]
    body = "\n".join(lines)
    return (
        f"static void {name}(const double* restrict in, double* restrict out) {{\n"
        f"  static const int starts[] = {{{', '.join(map(str, starts))}}};\n"
        f"  for (int g = 0; g < {len(starts)}; ++g) {{\n"
        "    const double* a = in + starts[g];\n    double* r = out + starts[g];\n"
        f"{body}\n  }}\n}}\n"
    )
