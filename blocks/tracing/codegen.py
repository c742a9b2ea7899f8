"""C code of programs: straight-line code with kernel calls in between."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from importlib.resources import files
from itertools import accumulate, groupby

import casadi as ca

from trussflow.blocks.tracing.instructions import TIME, Instruction, fused, instructions_of, is_time, named
from trussflow.blocks.tracing.operations import FORMULAS, OF_PRODUCTS, Numbers
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.rolling import rolled
from trussflow.blocks.tracing.tracing import KERNEL, KernelCall

ARGUMENTS = (TIME, "x", "d", "p")

NUMBERS = Numbers()
"""One by one, as for a single run."""

OWN_NAME = "trussflow"

_WORK = """\
  {type} work[{size}] __attribute__((aligned(64)));
  {type}* restrict w = work;
  __asm__("" : "+r"(w));"""
"""The array w. Its alignment is hidden: GCC 12 that knows it copies 64 bytes to where only 32 are aligned."""

_STATIC = "static __attribute__((noinline)) "
"""What stands before a piece."""

_HIDDEN = '__attribute__((visibility("hidden"))) '
"""What stands before its declaration where it is in another file: no other library finds it."""

FILE = 100_000
"""Characters of a file, about."""

PIECE = 2000
"""Instructions in one C function at most: twice as many take compilers more than twice as long."""

KERNEL_PIECE = 250
"""The same in a kernel, where they are on vectors."""


def c_sources(programs: Sequence[Program], lanes: int = 1) -> list[str]:
    """Return C sources of programs with the stepping loop behind them.

    The pieces of large programs are in files that can be compiled at the same time; small programs
    share one file with the loop, so that they can be inlined.

    Parameters
    ----------
    programs : sequence of Program
        The first one is the derivative; all take (t, x, d, p).
    lanes : int
        How many runs they advance at once [-]: in the place of each number but time is a vector of these.
    """
    numbers = Numbers(lanes)
    names = [p.name for p in programs]
    macros = {
        "TF_X": programs[0].inputs[1].numel(),
        "TF_D": programs[0].inputs[2].numel(),
        "TF_OUTPUTS": int("outputs" in names),
        "TF_SAMPLES": "".join(f", tf_run_{n}" for n in names if n.startswith("sample_")),
        "TF_PROGRAMS": ", ".join(f"tf_run_{n}" for n in names),
        "TF_NUMBER": numbers.type,
    }
    defined = [f"#define {name} {value}" for name, value in (macros | event_sizes(programs)).items()]
    pieces, functions = c_functions(programs, "static ", numbers)
    begin = [0, *accumulate(map(len, pieces))]
    if begin[-1] < FILE:
        pieces, functions = [], [*pieces, *functions]
    apart = [piece.removeprefix(_STATIC) for piece in pieces]
    vectors = vector_functions() + f"TF_FUNCTIONS({lanes})\n" * (lanes > 4)
    main = [
        vectors,
        *defined,
        *(f"{_HIDDEN}{piece.partition(' {')[0]};" for piece in apart),
        *functions,
        fixed_step(),
        events(),
        _file("driver.c"),
    ]
    others = [
        [vectors, *(piece for _, piece in group)]
        for _, group in groupby(zip(begin, apart, strict=False), lambda one: one[0] // FILE)
    ]
    return ["\n".join(parts) for parts in [main, *others]]


def vector_functions() -> str:
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


def c_functions(
    programs: Sequence[Program], linkage: str, numbers: Numbers = NUMBERS
) -> tuple[list[str], list[str]]:
    """Return the C functions of programs and of the kernels they call: their pieces, then themselves.

    Parameters
    ----------
    programs : sequence of Program
        All take (t, x, d, p).
    linkage : str
        What to put before each program, such as ``"static "``.
    numbers : Numbers
        What they compute with.
    """
    kernels: dict[int, str] = {}
    pieces, whole = list[str](), list[str]()
    for call in (call for program in programs for call in program.calls):
        if id(call) not in kernels:
            kernels[id(call)] = f"tf_kernel_{len(kernels)}"
            *parts, kernel = _kernel(call, kernels[id(call)], numbers)
            pieces += parts
            whole.append(kernel)
    for program in programs:
        *parts, function = _program(program, kernels, numbers)
        pieces += parts
        whole.append(linkage + function)
    return pieces, whole


def _parameters(numbers: Numbers) -> str:
    """Return the parameters of the C functions of programs and their pieces."""
    types = ("double" if a == TIME else numbers.type for a in ARGUMENTS)
    given = (f"const {kind}* restrict {a}" for kind, a in zip(types, ARGUMENTS, strict=True))
    return ", ".join([*given, f"{numbers.type}* restrict result"])


def _head(name: str, numbers: Numbers) -> str:
    """Return the head of the C function of a program."""
    return f"void tf_run_{name}({_parameters(numbers)})"


def content(programs: Sequence[Program], lanes: int = 1) -> str:
    """Return what the C source of programs is made from, quicker than the source itself.

    Parameters
    ----------
    programs : sequence of Program
        As for `c_sources`.
    lanes : int
        As for `c_sources` [-].
    """
    made_by = ("codegen.py", "instructions.py", "rolling.py", "operations.py")
    made_of = ("fma.h", "lanes.h", "fixed_step.h", "events.h", "driver.c")
    return "\0".join([str(lanes), *(program.code for program in programs), *map(_file, made_by + made_of)])


@cache
def _file(name: str) -> str:
    """Return a file of this folder, the same whatever name the package was given in an FMU."""
    text = files("trussflow.blocks.tracing").joinpath(name).read_text(encoding="utf-8")
    return text.replace(f"{__name__.partition('.')[0]}.", f"{OWN_NAME}.")


def _program(program: Program, kernels: dict[int, str], numbers: Numbers) -> list[str]:
    """Return the C functions of a program, its own the last; a long one calls functions of its pieces."""
    # In w are the arguments and results of the kernels, and what one piece computes for another.
    read, written, size = [f"{a}[{{}}]" for a in ARGUMENTS], list[str](), 0
    called: list[str] = []
    for call in program.calls:
        starts = []
        for names, symbols in ((written, call.inputs), (read, call.symbols)):
            starts.append(f"w + {size}")
            names.append(f"w[{size} + {{}}]")
            size += -(-symbols.numel() // 8) * 8  # whole lines of 64 bytes
        called.append(f"  {kernels[id(call)]}({', '.join(starts)});")
    written += ["result[{}]", f"w[{size} + {{}}]"]
    found = rolled(fused(instructions_of(program.graph)), read, len(program.calls), written[-1], numbers)
    instructions, loops, common = found
    size += common
    apart = len(instructions) > PIECE
    length = PIECE if apart else max(len(instructions), 1)
    stages = _stages(instructions, len(program.calls))
    pieces = [stage[i : i + length] for stage in stages for i in range(0, len(stage), length)]
    bodies, shared = _bodies(instructions, pieces, read, written, size if apart else None, numbers)

    functions: list[str] = []
    size = max(size + shared, 1)
    lines = [_WORK.format(size=size, type=numbers.type)] if apart or program.calls or common else []
    for i, stage in enumerate(stages):
        for _ in range(0, len(stage), length):
            body = bodies.pop(0)
            if apart:
                name = f"tf_{program.name}_{len(functions)}"
                head = f"{name}({_parameters(numbers)}, {numbers.type}* restrict w)"
                functions.append(_apart(head, body))
                body = [f"  {name}({', '.join(ARGUMENTS)}, result, w);"]
            lines += body
        lines += called[i : i + 1]
    return [*functions, "\n".join([f"{_head(program.name, numbers)} {{", *lines, *loops, "}", ""])]


def _apart(head: str, body: Sequence[str]) -> str:
    """Return the C function of a piece, of that name and parameters, which compilers leave apart."""
    return "\n".join([f"{_STATIC}void {head} {{", *body, "}", ""])


def _bodies(
    instructions: Sequence[Instruction],
    pieces: Sequence[Sequence[int]],
    read: Sequence[str],
    written: Sequence[str],
    first: int | None,
    numbers: Numbers,
) -> tuple[list[list[str]], int]:
    """Return the statements of each piece, and how many elements of w they share.

    These begin at the `first`; with None all pieces are in one function and share its variables. What is
    `read` and `written` are C's words for an element, with ``{}`` for its number.
    """
    places, shared = ({}, 0) if first is None else _shared(instructions, pieces, first)
    text = [named(k, instruction, read, numbers) for k, instruction in enumerate(instructions)]
    sums = {text[k] for k, instruction in enumerate(instructions) if instruction.operation in OF_PRODUCTS}
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
                if source.operation == ca.OP_INPUT and not is_time(read[source.place[0]]):
                    moves.append((*instruction.place, *source.place))
                else:
                    target, element = instruction.place
                    body.append(f"  {written[target].format(element)} = {operands[0]};")
            elif instruction.operation in FORMULAS:
                computed = numbers.computed(instruction.operation, operands, sums)
                body.append(f"  const {numbers.type} v{k} = {computed};")
            if k in places:
                body.append(f"  w[{places[k]}] = v{k};")
        bodies.append(body + _moved(moves, written, read))
    return bodies, shared


def straight_line(function: ca.Function, read: Sequence[str], written: Sequence[str]) -> str:
    """Return the C statements of an SX `function`; its arguments and results are called `read`, `written`."""
    instructions = fused(instructions_of(function))
    given, made = ([f"{name}[{{}}]" for name in names] for names in (read, written))
    bodies, _ = _bodies(instructions, [range(len(instructions))], given, made, None, NUMBERS)
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
            f"{targets[target].format(f'{to} + i')} = {arguments[argument].format(f'{source} + i')};"
        )
    return lines


def _kernel(call: KernelCall, name: str, numbers: Numbers) -> list[str]:
    """Return the C functions of a kernel, the last its own; lanes are its instances, or runs."""
    count, runs = call.inputs.size2(), numbers.lanes
    if call.kernel.source:
        each = f"{name}_each" if runs > 1 else name
        source = call.kernel.source.replace(KERNEL, each)
        return [source + (_in_each_lane(call, name, each, numbers) if runs > 1 else "")]
    # The last group overlaps the one before where the lanes do not divide the instances.
    together = 1 if runs > 1 else 4 if count >= 4 else 2
    starts = [min(g, count - together) for g in range(0, count, together)]
    numbers = Numbers(runs * together, series=True)
    kind, own = numbers.type, NUMBERS.type if runs == 1 else numbers.type
    instructions = fused(instructions_of(call.kernel.function))
    apart = len(instructions) > KERNEL_PIECE
    length = KERNEL_PIECE if apart else max(len(instructions), 1)
    pieces = [range(i, min(i + length, len(instructions))) for i in range(0, len(instructions), length)]
    read, written = [f"(*(const {kind}*)(a + {count} * ({{}})))"], [f"(*({kind}*)(r + {count} * ({{}})))"]
    bodies, shared = _bodies(instructions, pieces, read, written, 0 if apart else None, numbers)
    functions, lines = list[str](), bodies[0]
    if apart:
        lines = [_WORK.format(size=max(shared, 1), type=kind)]
        for k, body in enumerate(bodies):
            head = f"{name}_{k}(const {own}* restrict a, {own}* restrict r, {kind}* restrict w)"
            functions.append(_apart(head, body))
            lines.append(f"    {name}_{k}(a, r, w);")
    whole = (
        f"static void {name}(const {own}* restrict in, {own}* restrict out) {{\n"
        f"  static const int starts[] = {{{', '.join(map(str, starts))}}};\n"
        f"  for (int g = 0; g < {len(starts)}; ++g) {{\n"
        f"    const {own}* a = in + starts[g];\n    {own}* r = out + starts[g];\n"
        + "\n".join([*lines, "  }", "}", ""])
    )
    return [*functions, whole]


def _in_each_lane(call: KernelCall, name: str, each: str, numbers: Numbers) -> str:
    """Return the C function that calls, for one run after the other, `each`, a kernel's C of its own."""
    return (
        f"static void {name}(const {numbers.type}* restrict in, {numbers.type}* restrict out) {{\n"
        f"  double own[{call.inputs.numel()}], results[{call.symbols.numel()}];\n"
        f"  for (int lane = 0; lane < {numbers.lanes}; ++lane) {{\n"
        f"    for (int i = 0; i < {call.inputs.numel()}; ++i) own[i] = in[i][lane];\n"
        f"    {each}(own, results);\n"
        f"    for (int i = 0; i < {call.symbols.numel()}; ++i) out[i][lane] = results[i];\n"
        "  }\n}\n"
    )
