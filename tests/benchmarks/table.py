"""Rows of the table of ``run.py``, and the check that the ratios among them hold."""

from __future__ import annotations

from dataclasses import dataclass

from trussflow.blocks.tracing.compiler import lanes

# What is wanted of ratios of two things that are measured in turn in one process. Times of whole
# processes and absolute times depend on the machine: they have no place here.
TARGETS = {
    "flexible 40-DOF forward dynamics / Pinocchio aba, rigid 34": 0.6,
    "80 states, two blocks (job B) / numba by hand": 1.3,
    "2 states, two blocks (job A) / numba by hand": 5.0,
    # measured with 8 lanes, of AVX-512
    "80 states (job B), samples at once on one core / alone": 0.4 * 8 / lanes(),
    "10,000 samples of 500 steps of three states / numba by hand": 3.0,
    "engine with 300 sparks, RK4 at 1 ms / SciPy from event to event": 0.1,
    "doStep of 1 ms / four compiled right-hand sides": 1.5,
    "imported FMU, a step: ours / bare C calls": 1.15,
    "the same FMU as a block in a diagram, a step / bare C calls": 11.0,
}
SLACK = 2.0
"""How many times its target a ratio may be before the check fails: machines and their load differ."""

ATTEMPTS = 3
"""How often the check measures what is too slow before it believes it."""


@dataclass(frozen=True)
class Row:
    """One line of the table: a ratio, whose name is in `TARGETS`, or a figure that is only printed."""

    name: str
    figure: str
    target: str = ""
    ratio: float | None = None

    @classmethod
    def of(cls, name, ours, theirs, ratio, per=1e-6):
        """Return the row of two times [s] and their ratio, shown in units of `per` [s]."""
        unit = {1e-6: "us", 1e-9: "ns"}[per]
        figure = f"{ours / per:.3g} {unit} / {theirs / per:.3g} {unit} = {ratio:.2f}"
        return cls(name, figure, f"<= {TARGETS[name]:g}", ratio)

    @property
    def limit(self):
        """What the ratio may be at most."""
        return SLACK * TARGETS[self.name]


def show(rows):
    """Print the table."""
    cells = [
        ("what", "median", "target"),
        *((row.name, row.figure, row.target) for row in rows),
    ]
    widths = [max(len(row[i]) for row in cells) for i in range(3)]
    for line in cells:
        print(
            "  ".join(
                cell.ljust(w) for cell, w in zip(line, widths, strict=True)
            ).rstrip()
        )


def check(benchmarks):
    """Measure, again where a ratio is above its limit; print the table and return the exit code."""
    rows = [row for benchmark in benchmarks for row in best_of_attempts(benchmark)]
    show(rows)
    slow = [row for row in rows if row.ratio is not None and row.ratio > row.limit]
    for row in slow:
        print(
            f"too slow: {row.name}: {row.ratio:.2f}, and may be {row.limit:.2f} at most"
        )
    if unmeasured := TARGETS.keys() - {row.name for row in rows}:
        print(f"not measured: {', '.join(sorted(unmeasured))}")
    return 1 if slow or unmeasured else 0


def best_of_attempts(benchmark):
    """Return the rows of a benchmark, each at its best; measured again only while one is too slow."""
    best = {}
    for _ in range(ATTEMPTS):
        for row in benchmark():
            known = best.get(row.name)
            if known is None or known.ratio is None or (row.ratio or 0.0) < known.ratio:
                best[row.name] = row
        if all(row.ratio is None or row.ratio <= row.limit for row in best.values()):
            break
    return list(best.values())
