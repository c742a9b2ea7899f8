"""``python -m trussflow.models.modal_analysis``: modes, margins, poles and reduced models."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from trussflow.blocks.framework.command_line import Outcome, ended, parser_of
from trussflow.blocks.framework.files import replaced
from trussflow.blocks.framework.telling import told
from trussflow.models.modal_analysis.study import Study
from trussflow.models.reporting.output_folder import prepared_folder
from trussflow.models.transport.mission import CASES

PROG = "python -m trussflow.models.modal_analysis"


def parser(prog: str = PROG) -> argparse.ArgumentParser:
    """Return what reads the words behind `prog`, the command."""
    found = parser_of(
        prog,
        "Natural modes, Bode plots, margins, poles and reduced models of the truss\n"
        "held at rest by the controllers of Li, Wei, Chen (2026).",
        "--quick                             # a minute instead of several",
        "--case 2 --output results/modes2    # with the gains of Case 2",
        "--amplitude 1e-4 --omega 0.5        # describing functions for smaller, slower errors",
    )
    found.add_argument("--quick", action="store_true", help="fewer modes, a coarser map")
    found.add_argument("--case", type=int, choices=CASES, default=1, help="whose gains")
    found.add_argument(
        "--amplitude",
        type=float,
        default=1e-3,
        help="of the errors [m, rad], for the describing functions of the laws",
    )
    found.add_argument("--omega", type=float, default=1.0, help="frequency of that oscillation [rad/s]")
    found.add_argument(
        "--output", type=Path, default=Path("results/modal_analysis"), help="folder for tables and figures"
    )
    return found


def analyse(options: argparse.Namespace) -> Outcome:
    """Compute and write what the `options` ask for."""
    study = Study(
        folder=prepared_folder(options.output),
        case=options.case,
        quick=options.quick,
        amplitude=options.amplitude,
        omega=options.omega,
    )
    parts, tables = [], iter(study.tables())
    while True:
        with told("analysing"):
            found = next(tables, None)
        if found is None:
            break
        title, table = found
        print(f"{title}\n\n{table}\n", flush=True)
        parts.append((title, table))
    with replaced(options.output / "tables.txt") as partial:
        partial.write_text("\n".join(f"{title}\n\n{table}\n" for title, table in parts), encoding="utf-8")
    facts = {"folder": options.output, "margins": study.margins, "tables": dict(parts)}
    return Outcome(facts, f"written to {options.output}: tables.txt, margins.csv, spillover.nc and figures")


def main(words: list[str] | None = None, prog: str = PROG) -> int:
    """Run the command `prog` with these `words`, by default the process's; return the exit code."""
    return ended(analyse, parser(prog).parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
