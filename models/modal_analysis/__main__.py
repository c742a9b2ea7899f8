"""``python -m trussflow.models.modal_analysis``: modes, margins, poles and reduced models."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.files import replaced
from trussflow.models.modal_analysis.study import Study
from trussflow.models.reporting.output_folder import prepared_folder
from trussflow.models.transport.mission import CASES


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m trussflow.models.modal_analysis",
        description="Natural modes, Bode plots, margins, poles and reduced models of the truss "
        "held at rest by the controllers of Li, Wei, Chen (2026).",
    )
    parser.add_argument("--quick", action="store_true", help="fewer modes, a coarser map")
    parser.add_argument("--case", type=int, choices=CASES, default=1, help="whose gains")
    parser.add_argument(
        "--amplitude",
        type=float,
        default=1e-3,
        help="of the errors [m, rad], for the describing functions of the laws",
    )
    parser.add_argument("--omega", type=float, default=1.0, help="frequency of that oscillation [rad/s]")
    parser.add_argument(
        "--output", type=Path, default=Path("results/modal_analysis"), help="folder for tables and figures"
    )
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> int:
    """Run the command; errors that the user can mend are one line, not a traceback."""
    options = arguments(words)
    try:
        study = Study(
            folder=prepared_folder(options.output),
            case=options.case,
            quick=options.quick,
            amplitude=options.amplitude,
            omega=options.omega,
        )
        text = []
        for title, table in study.tables():
            print(f"{title}\n\n{table}\n", flush=True)
            text.append(f"{title}\n\n{table}\n")
        with replaced(options.output / "tables.txt") as partial:
            partial.write_text("\n".join(text), encoding="utf-8")
    except TrussflowError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"written to {options.output}: tables.txt, margins.csv, spillover.nc and figures")
    return 0


if __name__ == "__main__":
    sys.exit(main())
