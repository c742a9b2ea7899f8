"""Generation of C code from programs: straight-line code between kernel calls."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate, chain, groupby

import casadi as ca
import numpy as np

from trussflow.blocks.tracing.instructions import (
    TIME_NAME,
    Instruction,
    fused,
    instructions_of,
    is_time,
    named,
)
from trussflow.blocks.tracing.kernels import KERNEL_NAME, KernelCall
from trussflow.blocks.tracing.loop_rerolling import rerolled
from trussflow.blocks.tracing.operations import (
    FORMULAS,
    FUSED_FORMULAS,
    Numbers,
    c_file,
)
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.variable_step import SparseJacobian, definitions

PROGRAM_ARGUMENTS = (TIME_NAME, "x", "d", "p")

SCALAR_NUMBERS = Numbers()
"""Scalar arithmetic, for a single run."""

_WORK = """\
  {type} work[{size}] __attribute__((aligned(64)));
  {type}* restrict w = work;
  __asm__("" : "+r"(w));"""
"""Declaration of the work array w.

The inline assembly hides the alignment of w: GCC 12 otherwise uses aligned 64-byte moves for operands that
are aligned to 32 bytes only.
"""

_STATIC = "static __attribute__((noinline)) "
"""Specifiers of the C function of a piece, which prevent inlining."""

_HIDDEN = '__attribute__((visibility("hidden"))) '
"""Specifier of the declaration of a piece in another file; it hides the symbol from other libraries."""

FIXED_STEP_FILES = ("fixed_step.h", "events.h")
"""C code of fixed steps, after the programs of a simulation."""

VARIABLE_FILES = ("fixed_step.h", "variable_step.h", "events.h", "variable_span.h")
"""C code of fixed and variable steps."""

MIN_FILE_SIZE = 100_000
"""Size of the C code [characters] above which it is split into several files of about this size."""

MAX_PIECE_INSTRUCTIONS = 2000
"""Largest number of instructions in one C function; the compile time grows faster than this number."""

MAX_KERNEL_PIECE_INSTRUCTIONS = 250
"""Largest number of instructions in one C function of a kernel, where operands are vectors."""


def c_sources(
    programs: Sequence[Program], lanes: int = 1, variable: bool = False
) -> list[str]:
    """Return the C sources of programs, followed by the time-stepping loop.

    The pieces of large programs are distributed over files that can be compiled in parallel. Small
    programs share one file with the loop, so that the compiler can inline them.

    Parameters
    ----------
    programs : sequence of Program
        Programs of (t, x, d, p); the first one is the derivative.
    lanes : int
        Number of runs advanced at the same time [-]; each number except time is a vector of this length.
    variable : bool
        Whether steps of variable length are possible, with a stiff method if "tangent" is a program.
    """
    numbers = Numbers(lanes)
    names = [p.name for p in programs]
    jacobian = SparseJacobian(programs[0]) if "tangent" in names else None
    macros = {
        "TF_X": programs[0].inputs[1].numel(),
        "TF_D": programs[0].inputs[2].numel(),
        "TF_BLOCKS": sum(n.startswith("continuous_") for n in names),
        "TF_OUTPUTS": int("outputs" in names),
        "TF_SAMPLES": "".join(
            f", tf_run_{n}" for n in names if n.startswith("sample_")
        ),
        "TF_PROGRAMS": ", ".join(f"tf_run_{n}" for n in names),
        "TF_NUMBER": numbers.type,
    }
    defined = [
        f"#define {name} {value}"
        for name, value in (macros | event_sizes(programs)).items()
    ]
    pieces, functions = c_functions(programs, "static ", numbers)
    begin = [0, *accumulate(map(len, pieces))]
    # Small programs: pieces stay static functions of the main file.
    if begin[-1] < MIN_FILE_SIZE:
        pieces, functions = [], [*pieces, *functions]
    apart = [piece.removeprefix(_STATIC) for piece in pieces]
    vectors = vector_functions() + f"TF_FUNCTIONS({lanes})\n" * (lanes > 4)
    main = [
        vectors,
        *defined,
        *(f"{_HIDDEN}{piece.partition(' {')[0]};" for piece in apart),
        *functions,
        *([definitions(jacobian)] if variable else []),
        *map(c_file, _simulation_files(variable)),
    ]
    others = [
        [vectors, *(piece for _, piece in group)]
        for _, group in groupby(
            zip(begin, apart, strict=False), lambda one: one[0] // MIN_FILE_SIZE
        )
    ]
    return ["\n".join(parts) for parts in [main, *others]]


def vector_functions() -> str:
    """Return the C declarations that programs with kernels need; others need only those of fma.h."""
    return c_file("fma.h") + c_file("lanes.h")


def event_sizes(programs: Iterable[Program]) -> dict[str, int]:
    """Return the numbers of events, modes, loop guesses and stored signals, by the macros of events.h."""
    sizes = {program.name: program.size for program in programs}
    # The program of the events computes x and the modes, that of the derivative x only.
    modes = sizes["on_event"] - sizes["derivative"] if "on_event" in sizes else 0
    return {
        "TF_EVENTS": sizes.get("indicators", 0),
        "TF_MODES": modes,
        "TF_LOOPS": sizes.get("guesses", 0),
        "TF_STORED": sizes.get("stored", 0),
    }


def c_functions(
    programs: Sequence[Program], linkage: str, numbers: Numbers = SCALAR_NUMBERS
) -> tuple[list[str], list[str]]:
    """Return the C functions of the pieces, and those of the kernels and programs that call the pieces.

    Parameters
    ----------
    programs : sequence of Program
        Programs of (t, x, d, p).
    linkage : str
        Specifiers before the function of each program, such as ``"static "``.
    numbers : Numbers
        Type of numbers.
    """
    kernels: dict[int, str] = {}
    pieces, whole = list[str](), list[str]()
    for call in (call for program in programs for call in program.calls):
        # Programs of one trace share calls, and each call is compiled once.
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
    types = ("double" if a == TIME_NAME else numbers.type for a in PROGRAM_ARGUMENTS)
    given = (
        f"const {kind}* restrict {a}"
        for kind, a in zip(types, PROGRAM_ARGUMENTS, strict=True)
    )
    return ", ".join([*given, f"{numbers.type}* restrict result"])


def _simulation_files(variable: bool) -> tuple[str, ...]:
    """Return the files with C code after the programs of a simulation; for `variable` see `c_sources`."""
    return (*(VARIABLE_FILES if variable else FIXED_STEP_FILES), "driver.c")


def content(programs: Sequence[Program], lanes: int = 1, variable: bool = False) -> str:
    """Return a text that determines the C sources of programs; it is faster to make than the sources.

    Parameters
    ----------
    programs : sequence of Program
        As for `c_sources`.
    lanes : int
        As for `c_sources` [-].
    variable : bool
        As for `c_sources`.
    """
    # The text includes the generator itself: a new version must not find old libraries.
    parts = ["codegen.py", "instructions.py", "loop_rerolling.py", "operations.py"]
    parts += ["fma.h", "lanes.h", *_simulation_files(variable)]
    if variable:
        parts += ["tableaus.py", "variable_step.py"]
    return "\0".join(
        [str(lanes), *(program.code for program in programs), *map(c_file, parts)]
    )


def _program(program: Program, kernels: dict[int, str], numbers: Numbers) -> list[str]:
    """Return the C functions of a program; if it is long, those of its pieces come first."""
    # The array w holds the arguments and results of kernels, and values shared by pieces.
    read, written, size = [f"{a}[{{}}]" for a in PROGRAM_ARGUMENTS], list[str](), 0
    called: list[str] = []
    for call in program.calls:
        starts = []
        for names, symbols in ((written, call.inputs), (read, call.symbols)):
            starts.append(f"w + {size}")
            names.append(f"w[{size} + {{}}]")
            size += -(-symbols.numel() // 8) * 8  # whole lines of 64 bytes
        if call.kernel.reads:
            starts.append(f"d + {program.history(call)[1]}")
        called.append(f"  {kernels[id(call)]}({', '.join(starts)});")
    written += ["result[{}]", f"w[{size} + {{}}]"]
    found = rerolled(
        fused(instructions_of(program.graph)),
        read,
        len(program.calls),
        written[-1],
        numbers,
    )
    instructions, loops, common = found
    arguments = ", ".join((*PROGRAM_ARGUMENTS, "result", "w"))
    functions, bodies, size = _divided(
        instructions,
        _stages(instructions, len(program.calls)),
        MAX_PIECE_INSTRUCTIONS,
        (read, written),
        size + common,
        numbers,
        f"tf_{program.name}_{{}}({_parameters(numbers)}, {numbers.type}* restrict w)",
        f"  tf_{program.name}_{{}}({arguments});",
    )
    lines = [f"void tf_run_{program.name}({_parameters(numbers)}) {{"]
    if functions or size:
        lines.append(_WORK.format(size=max(size, 1), type=numbers.type))
    for i, body in enumerate(bodies):
        lines += [*body, *called[i : i + 1]]
    return [*functions, "\n".join([*lines, *loops, "}", ""])]


def _divided(
    instructions: Sequence[Instruction],
    stages: Sequence[Sequence[int]],
    most: int,
    arrays: tuple[Sequence[str], Sequence[str]],
    size: int,
    numbers: Numbers,
    head: str,
    call: str,
) -> tuple[list[str], list[list[str]], int]:
    """Return the C functions of pieces, the C statements of each stage, and the size of w.

    Parameters
    ----------
    instructions : sequence of Instruction
        All instructions.
    stages : sequence of sequence of int
        Instructions of each stage.
    most : int
        Number of instructions [-] above which the stages are divided into pieces of at most this length.
    arrays : pair of sequence of str
        C expressions of an element of each array that is read and written, with ``{}`` for its index.
    size : int
        Size of w so far [-]; values that pieces share follow.
    numbers : Numbers
        Type of numbers.
    head, call : str
        Head of the C function of a piece and statement that calls it, with ``{}`` for its number.
    """
    if len(instructions) <= most:
        return [], _bodies(instructions, stages, *arrays, {}, numbers), size
    divided = [
        [stage[i : i + most] for i in range(0, len(stage), most)] for stage in stages
    ]
    pieces = list(chain(*divided))
    places, size = _shared(instructions, pieces, size)
    functions = [
        "\n".join([f"{_STATIC}void {head.format(k)} {{", *body, "}", ""])
        for k, body in enumerate(
            _bodies(instructions, pieces, *arrays, places, numbers)
        )
    ]
    calls = map(call.format, range(len(pieces)))
    return functions, [[next(calls) for _ in stage] for stage in divided], size


def _bodies(
    instructions: Sequence[Instruction],
    pieces: Sequence[Sequence[int]],
    read: Sequence[str],
    written: Sequence[str],
    places: Mapping[int, int],
    numbers: Numbers,
) -> list[list[str]]:
    """Return the C statements of each piece.

    `places` are the indices in w of the values that pieces share. `read` and `written` are C expressions of
    an element, with ``{}`` for its index.
    """
    text = [
        named(k, instruction, read, numbers)
        for k, instruction in enumerate(instructions)
    ]
    # Results of fused operations, whose negation needs protection, see
    # `Numbers.computed`.
    sums = {
        text[k]
        for k, instruction in enumerate(instructions)
        if instruction.operation in FUSED_FORMULAS
    }
    bodies: list[list[str]] = []
    for piece in pieces:
        here, body, moves = set(piece), list[str](), list[tuple[int, ...]]()
        for k in piece:
            instruction = instructions[k]
            operands = [
                f"w[{places[o]}]" if o in places and o not in here else text[o]
                for o in instruction.operands
            ]
            if instruction.operation == ca.OP_OUTPUT:
                source = instructions[instruction.operands[0]]
                # Time is a scalar also with several lanes, so that it is no plain copy.
                if source.operation == ca.OP_INPUT and not is_time(
                    read[source.place[0]]
                ):
                    moves.append((*instruction.place, *source.place))
                else:
                    target, element = instruction.place
                    body.append(f"  {written[target].format(element)} = {operands[0]};")
            elif instruction.operation in FORMULAS:
                computed = numbers.computed(instruction.operation, operands, sums)
                body.append(f"  const {numbers.type} v{k} = {computed};")
            if k in places:
                # Stored at once, as the variables of a C function end with its piece.
                body.append(f"  w[{places[k]}] = v{k};")
        bodies.append(body + _moved(moves, written, read))
    return bodies


def straight_line(
    function: ca.Function, read: Sequence[str], written: Sequence[str]
) -> str:
    """Return the C statements of an SX `function`, with the array names `read` and `written`."""
    instructions = fused(instructions_of(function))
    given, made = ([f"{name}[{{}}]" for name in names] for names in (read, written))
    stages = [range(len(instructions))]
    (body,) = _bodies(instructions, stages, given, made, {}, SCALAR_NUMBERS)
    return "\n".join(body)


def _shared(
    instructions: Sequence[Instruction], pieces: Sequence[Sequence[int]], size: int
) -> tuple[dict[int, int], int]:
    """Return the index in w of each value that a later piece needs, and the new size of w.

    An element is reused as soon as no later piece needs its value. The first one is at the end of w so far.
    """
    last = {
        o: n
        for n, piece in enumerate(pieces)
        for k in piece
        for o in instructions[k].operands
    }
    places: dict[int, int] = {}
    free: list[int] = []  # elements that no later piece needs
    for n, piece in enumerate(pieces):
        # Values last used by the piece before leave their elements to this piece.
        free += [place for k, place in places.items() if last[k] == n - 1]
        for k in piece:
            if last.get(k, n) > n and instructions[k].operation not in (
                ca.OP_INPUT,
                ca.OP_CONST,
            ):
                if not free:
                    free.append(size)
                    size += 1
                places[k] = free.pop()
    return places, size


def _stages(instructions: Sequence[Instruction], calls: int) -> list[list[int]]:
    """Return the instructions before each kernel call and after the last one.

    Each instruction is assigned to the first stage that needs its result.
    """
    stage = [calls] * len(instructions)
    # Backwards, as operands precede the instructions that use them.
    for k in reversed(range(len(instructions))):
        instruction = instructions[k]
        if instruction.operation == ca.OP_OUTPUT:
            stage[k] = min(instruction.place[0], calls)
        for operand in instruction.operands:
            stage[operand] = min(stage[operand], stage[k])
    return [[k for k, s in enumerate(stage) if s == i] for i in range(calls + 1)]


def _moved(
    moves: Sequence[tuple[int, ...]], targets: Sequence[str], arguments: Sequence[str]
) -> list[str]:
    """Return C statements that copy numbers; consecutive sources with consecutive targets share one loop.

    Thousands of single statements would take the compiler minutes, and the run as long as the computation.
    """
    lines = []
    ordered = np.array(sorted(moves), dtype=int).reshape(-1, 4)
    begin = np.flatnonzero(np.any(np.diff(ordered, axis=0) != [0, 1, 0, 1], axis=1)) + 1
    for each in np.split(ordered, begin) if moves else ():
        target, to, argument, source = each[0].tolist()
        lines.append(
            f"  for (int i = 0; i < {len(each)}; ++i) "
            f"{targets[target].format(f'{to} + i')} = {arguments[argument].format(f'{source} + i')};"
        )
    return lines


def _kernel(call: KernelCall, name: str, numbers: Numbers) -> list[str]:
    """Return the C functions of a kernel, pieces first; the vector lanes are its instances and the runs."""
    count, runs = call.inputs.size2(), numbers.lanes
    if call.kernel.source:
        each = f"{name}_each" if runs > 1 else name
        source = call.kernel.source.replace(KERNEL_NAME, each)
        return [source + (_in_each_lane(call, name, each, numbers) if runs > 1 else "")]
    # If the lanes do not divide the instances, the last group overlaps the group before it.
    together = 1 if runs > 1 else 4 if count >= 4 else 2
    starts = [min(g, count - together) for g in range(0, count, together)]
    numbers = Numbers(runs * together, series=True)
    kind, own = numbers.type, SCALAR_NUMBERS.type if runs == 1 else numbers.type
    instructions = fused(instructions_of(call.kernel.function))
    functions, (lines,), size = _divided(
        instructions,
        [range(len(instructions))],
        MAX_KERNEL_PIECE_INSTRUCTIONS,
        (
            [f"(*(const {kind}*)(a + {count} * ({{}})))"],
            [f"(*({kind}*)(r + {count} * ({{}})))"],
        ),
        0,
        numbers,
        f"{name}_{{}}(const {own}* restrict a, {own}* restrict r, {kind}* restrict w)",
        f"    {name}_{{}}(a, r, w);",
    )
    if functions:
        lines.insert(0, _WORK.format(size=max(size, 1), type=kind))
    whole = (
        f"static void {name}(const {own}* restrict in, {own}* restrict out) {{\n"
        f"  static const int starts[] = {{{', '.join(map(str, starts))}}};\n"
        f"  for (int g = 0; g < {len(starts)}; ++g) {{\n"
        f"    const {own}* a = in + starts[g];\n    {own}* r = out + starts[g];\n"
        + "\n".join([*lines, "  }", "}", ""])
    )
    return [*functions, whole]


def _in_each_lane(call: KernelCall, name: str, each: str, numbers: Numbers) -> str:
    """Return the C function that calls `each`, the scalar C function of a kernel, for every run."""
    return (
        f"static void {name}(const {numbers.type}* restrict in, {numbers.type}* restrict out) {{\n"
        f"  double own[{call.inputs.numel()}], results[{call.symbols.numel()}];\n"
        f"  for (int lane = 0; lane < {numbers.lanes}; ++lane) {{\n"
        f"    for (int i = 0; i < {call.inputs.numel()}; ++i) own[i] = in[i][lane];\n"
        f"    {each}(own, results);\n"
        f"    for (int i = 0; i < {call.symbols.numel()}; ++i) out[i][lane] = results[i];\n"
        "  }\n}\n"
    )
