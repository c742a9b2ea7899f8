"""``python -m trussflow.models.transport``: fly one mission and say how it went."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, cast

from trussflow.blocks.framework.command_line import FAILED, ended, parser_of
from trussflow.blocks.framework.errors import DivergenceError, SimulationInterrupted
from trussflow.blocks.framework.files import replaced
from trussflow.blocks.simulation.adaptive import METHODS
from trussflow.blocks.simulation.results import save
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.output_folder import prepared_folder
from trussflow.models.transport.figures import draw
from trussflow.models.transport.index import write_index
from trussflow.models.transport.logged_ports import logged
from trussflow.models.transport.mission import CASES, Mission
from trussflow.models.transport.results import tidy
from trussflow.models.transport.summary import as_json, summarize, table
from trussflow.models.transport.wiring import ALLOCATIONS, CONTROLLERS, transport_diagram

if TYPE_CHECKING:
    import xarray as xr

PROG = "python -m trussflow.models.transport"

LOGGED_EVERY = 10
"""Steps between logged instants."""

STIFF_SOLVER = "LSODA"
"""Default for PD: its fastest pole, k_d over the least inertia, is near 1e7 1/s."""


def parser(prog: str = PROG) -> argparse.ArgumentParser:
    """Return what reads the words behind `prog`, the command."""
    found = parser_of(
        prog,
        "Four space robots carry a flexible truss (Li, Wei, Chen 2026, section 4).",
        "--case 1                                # results/case1: page, result, figures, summary",
        "--case 2 --controller smc --duration 20 # the turn, without integral, its first 20 s",
        "--plant consistent --allocation published   # what the actuators then do to the modes",
        "--duration 5 --json                     # figures and provenance for other programs",
    )
    found.add_argument("--case", type=int, choices=CASES, default=1, help="mission of the paper")
    found.add_argument(
        "--plant",
        choices=("published", "consistent"),
        default="published",
        help="the paper's model, or the exact one with actuators that work on the modes",
    )
    found.add_argument(
        "--arm",
        choices=("literal", "jaco"),
        default="literal",
        help="Table 2 as printed, or the true arm behind it",
    )
    found.add_argument(
        "--controller",
        choices=CONTROLLERS,
        default="ismc",
        help="integral sliding mode (the paper's), conventional sliding mode, or PD",
    )
    found.add_argument(
        "--observer",
        action=argparse.BooleanOptionalAction,
        help="estimate the disturbance; by default only with ismc",
    )
    found.add_argument(
        "--allocation",
        choices=ALLOCATIONS,
        help="all by Eq. 64, or feedback without work on the modes; default: what suits the plant",
    )
    found.add_argument("--duration", type=float, default=80.0, help="simulated time [s]")
    found.add_argument("--step", type=float, help="step of fixed-step solvers [s]")
    found.add_argument(
        "--solver", choices=(*FIXED_STEP, *METHODS), help=f"default: rk4; for PD {STIFF_SOLVER}"
    )
    found.add_argument("--output", type=Path, help="folder for result, summary and figures")
    found.add_argument("--json", action="store_true", help="print the summary as JSON")
    return found


def fly(options: argparse.Namespace, command: str) -> int:
    """Run the mission that the `options` of this `command` ask for, write all; return the exit code."""
    mission = Mission.of_case(options.case)
    folder = prepared_folder(options.output or Path(f"results/case{options.case}"))
    truss = getattr(SpaceTruss, options.plant)(arm=options.arm)
    diagram = transport_diagram(
        mission,
        truss,
        controller=options.controller,
        observer=options.observer,
        allocation=options.allocation,
    )
    solver = options.solver or (STIFF_SOLVER if options.controller == "pd" else "rk4")
    step = options.step if options.step is not None else mission.step
    simulator = Simulator(
        diagram, step=step, solver=solver, log=logged(diagram), log_step=LOGGED_EVERY * step
    )
    failure, started = "", time.perf_counter()
    try:
        result = simulator.run(options.duration)
    except (DivergenceError, SimulationInterrupted) as error:
        failure, result = str(error), cast("xr.Dataset", error.result)
    wall = time.perf_counter() - started
    result = result.assign_attrs(
        case=options.case,
        plant=options.plant,
        arm=options.arm,
        controller=options.controller,
        observer=int("observer" in diagram.blocks),
        allocation="published" if "allocation" in diagram.blocks else "mode-neutral",
        command=command,
    )
    told = sys.stderr if options.json else sys.stdout
    summary = report(tidy(result, truss), mission, truss, folder, wall, drawing=diagram.draw(), to=told)
    if options.json:
        print(summary, end="")
    if failure:
        print(f"\n{failure}", file=sys.stderr)
    return FAILED if failure else 0


def report(
    result: xr.Dataset,
    mission: Mission,
    truss: SpaceTruss,
    folder: Path,
    wall: float,
    *,
    drawing: str,
    to: TextIO,
) -> str:
    """Write result, summary, figures and the page of all, tell it `to` a stream; return the summary."""
    save(result, folder / "result.nc")
    figures = summarize(result, mission)
    summary = json.dumps(as_json(figures, result.attrs), indent=2) + "\n"
    with replaced(folder / "summary.json") as partial:
        partial.write_text(summary, encoding="utf-8")
    draw(result, folder)
    end = float(result["time"][-1])
    what = f"Case {mission.case}, {result.attrs['plant']} plant, {result.attrs['controller']}"
    print(f"{what}: {end:g} s in {wall:.2f} s, {end / wall:.0f} x real time\n", file=to)
    print(table(figures), file=to)
    print(f"\nwritten to {folder}: result.nc, summary.json and figures", file=to)
    if len(result["time"]) > 1:  # otherwise nothing moves
        page = write_index(result, mission, truss, figures, folder, drawing=drawing)
        print(f"to look at it, open {page} in a browser", file=to)
    return summary


def main(words: list[str] | None = None, prog: str = PROG) -> int:
    """Run the command `prog` with these `words`, by default the process's; return the exit code."""
    words = sys.argv[1:] if words is None else words
    options = parser(prog).parse_args(words)
    return ended(lambda: fly(options, f"{prog} {shlex.join(words)}"))


if __name__ == "__main__":
    sys.exit(main())
