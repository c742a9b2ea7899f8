"""``make bench-instructions``: what bounds one evaluation of a right-hand side, instruction by instruction.

A copy of this process evaluates it once, one instruction after the other (``PTRACE_SINGLESTEP``; Linux on
x86-64 only), and `objdump` says what each is. Cycles are told by a chain of additions, as a core
does one in each.
"""

from __future__ import annotations

import ctypes
import os
import re
import signal
import subprocess
import tempfile
from collections import Counter
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from run import REPETITIONS, elapsed, in_lanes
from table import Row, show

from trussflow.blocks import Diagram, Simulator
from trussflow.blocks.simulation.executor import CompiledExecutor
from trussflow.blocks.tracing.codegen import c_sources, content
from trussflow.blocks.tracing.compiler import (
    compile_library,
    compiled,
    find_compiler,
    lanes,
)
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

TRACE_ME, PEEK_USER, SINGLE_STEP = 0, 3, 9
POINTER = 16 * 8
"""Where the instruction pointer stands in what `PEEK_USER` shows."""

STEP, STEPS = 1e-3, 4000
ADDITIONS = 10_000_000
CHAIN = """
void chain(long long n) {
  long long x = 0;
  while (n--) __asm__ volatile(".rept 100\\n add $1, %0\\n .endr" : "+r"(x));
}
"""

WRITES = r"push|v?mov\S* [^,]*\["
KINDS = {
    "512 bits": r".*zmm",
    "256 bits": r"(?!.*zmm).*ymm",
    "sums, products": r"v(fn?m|add|sub|mul|max|min|and|or|xor|cmp|blend|rnd|scale)",
    "divisions, roots": r"v(div|sqrt)",
    "loads": rf"(?!lea|{WRITES}).*\[",
    "stores": WRITES,
}
"""What is counted, by how instruction and operands begin; one may be several: a sum loads a term."""


def executed(executor, library, *values):
    """Return how often each instruction is executed by one evaluation of the derivative, and their bytes."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.ptrace.restype = ctypes.c_long
    libc.ptrace.argtypes = [
        ctypes.c_long,
        ctypes.c_long,
        ctypes.c_void_p,
        ctypes.c_void_p,
    ]
    with open("/proc/self/maps", encoding="utf-8") as maps:
        mapped = [line.split() for line in maps if line.rstrip().endswith(library.name)]
    starts = [
        (int(m[0].split("-")[0], 16), int(m[0].split("-")[1], 16), int(m[2], 16))
        for m in mapped
    ]
    first = min(start - offset for start, _, offset in starts)
    last = max(end for _, end, _ in starts)
    child = os.fork()
    if not child:
        libc.ptrace(TRACE_ME, 0, None, None)
        os.kill(os.getpid(), signal.SIGSTOP)
        executor.call("derivative", 0.0, *values)
        os._exit(0)
    os.waitpid(child, 0)
    seen: Counter[int] = Counter()
    while True:
        libc.ptrace(SINGLE_STEP, child, None, None)
        if not os.WIFSTOPPED(os.waitpid(child, 0)[1]):
            break
        at = libc.ptrace(PEEK_USER, child, POINTER, None)
        if first <= at < last:
            seen[at - first] += 1
    listed = subprocess.run(
        ["objdump", "-d", "--no-show-raw-insn", "-M", "intel", str(library)],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    lines = re.findall(r"^ *([0-9a-f]+):\t(.*\S)", listed, re.MULTILINE)
    places = [int(address, 16) for address, _ in lines]
    found, size = Counter[str](), 0
    for (_, text), place, following in zip(
        lines, places, [*places[1:], places[-1]], strict=True
    ):
        found[re.sub(r" +", " ", text)] += seen[place]
        size += (following - place) * (place in seen)
    return found, size


def cycle():
    """Return how long a cycle of this core takes [s]."""
    command = find_compiler()
    assert command is not None
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "chain.c"
        source.write_text(CHAIN, encoding="utf-8")
        flags = ("-O2", "-shared", "-fPIC")
        chain = ctypes.CDLL(
            str(compiled([*command, *flags, str(source)], source.with_suffix(".so")))
        ).chain
        run = partial(chain, ctypes.c_longlong(ADDITIONS // 100))
        return float(min(elapsed(run) for _ in range(REPETITIONS))) / ADDITIONS


def rows_of(name, simulator, count=1):
    """Return what one evaluation of the derivative takes, of one run or in all lanes: a quarter of a step."""
    prepared = simulator.prepared
    programs, plan = prepared.programs, prepared.plan
    library = compile_library(
        content(programs, count), partial(c_sources, programs, count), ()
    )
    p = plan.parameters({})
    values = [*plan.initial(p, {}), p]
    if count > 1:
        values = [np.repeat(value[:, None], count, axis=1) for value in values]

    def seconds(steps):
        run = partial(simulator.run, steps * STEP, progress=False)
        if count > 1:
            run, _ = in_lanes(simulator, steps * STEP)
        return float(min(elapsed(run) for _ in range(REPETITIONS)))

    # The difference of two runs: what begins a run takes as long as hundreds of its steps.
    took = (seconds(2 * STEPS) - seconds(STEPS)) / (4 * STEPS)
    each, size = executed(CompiledExecutor(programs, plan, count), library, *values)
    total, cycles = each.total(), took / cycle()
    counts = {
        kind: sum(n for it, n in each.items() if re.match(text, it))
        for kind, text in KINDS.items()
    }
    parts = ", ".join(f"{kind} {n}" for kind, n in counts.items())
    return [
        Row(f"{name}: time", f"{1e6 * took:.2f} us, {cycles:.0f} cycles"),
        Row(f"{name}: instructions", f"{total}, {total / cycles:.1f} in a cycle"),
        Row(f"{name}: of these", parts),
        Row(
            f"{name}: code",
            f"{size / 1024:.0f} KiB, {size / cycles:.1f} bytes in a cycle",
        ),
    ]


def main():
    """Count for the plant alone, and for Case 1, alone and in lanes."""
    plant = Diagram("plant")
    truss = plant.add(truss=SpaceTruss.consistent())
    plant.ground(truss.actuation)
    loop = transport_diagram(Mission.of_case(1), SpaceTruss.published())
    alone, flight = (Simulator(diagram, step=STEP, log=[]) for diagram in (plant, loop))
    count = lanes()
    show(
        [
            *rows_of("forward dynamics", alone),
            *rows_of("Case 1", flight),
            *rows_of(f"Case 1, {count} runs in lanes", flight, count),
        ]
    )


if __name__ == "__main__":
    main()
