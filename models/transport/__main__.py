"""``python -m trussflow.models.transport``: fly one mission and say how it went."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, cast

from trussflow.blocks.framework.errors import DivergenceError, SimulationInterrupted, TrussflowError
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

LOGGED_EVERY = 10
"""Steps between logged instants."""

STIFF_SOLVER = "LSODA"
"""Default for PD: its fastest pole, k_d over the least inertia, is near 1e7 1/s."""


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m trussflow.models.transport",
        description="Four space robots carry a flexible truss (Li, Wei, Chen 2026, section 4).",
    )
    parser.add_argument("--case", type=int, choices=CASES, default=1, help="mission of the paper")
    parser.add_argument(
        "--plant",
        choices=("published", "consistent"),
        default="published",
        help="the paper's model, or the exact one with actuators that work on the modes",
    )
    parser.add_argument(
        "--arm",
        choices=("literal", "jaco"),
        default="literal",
        help="Table 2 as printed, or the true arm behind it",
    )
    parser.add_argument(
        "--controller",
        choices=CONTROLLERS,
        default="ismc",
        help="integral sliding mode (the paper's), conventional sliding mode, or PD",
    )
    parser.add_argument(
        "--observer",
        action=argparse.BooleanOptionalAction,
        help="estimate the disturbance; by default only with ismc",
    )
    parser.add_argument(
        "--allocation",
        choices=ALLOCATIONS,
        help="all by Eq. 64, or feedback without work on the modes; default: what suits the plant",
    )
    parser.add_argument("--duration", type=float, default=80.0, help="simulated time [s]")
    parser.add_argument("--step", type=float, help="step of fixed-step solvers [s]")
    parser.add_argument(
        "--solver", choices=(*FIXED_STEP, *METHODS), help=f"default: rk4; for PD {STIFF_SOLVER}"
    )
    parser.add_argument("--output", type=Path, help="folder for result, summary and figures")
    return parser.parse_args(words)


def fly(words: list[str]) -> int:
    """Run the mission that the command line asks for and write everything; return the exit code."""
    options = arguments(words)
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
        command=shlex.join(["python", "-m", "trussflow.models.transport", *words]),
    )
    report(tidy(result, truss), mission, truss, folder, wall, drawing=diagram.draw())
    if failure:
        print(f"\n{failure}", file=sys.stderr)
    return 1 if failure else 0


def report(
    result: xr.Dataset, mission: Mission, truss: SpaceTruss, folder: Path, wall: float, *, drawing: str
) -> None:
    """Write result, summary, figures and the page of all, and print the summary."""
    save(result, folder / "result.nc")
    figures = summarize(result, mission)
    with replaced(folder / "summary.json") as partial:
        partial.write_text(json.dumps(as_json(figures, result.attrs), indent=2) + "\n", encoding="utf-8")
    draw(result, folder)
    end = float(result["time"][-1])
    what = f"Case {mission.case}, {result.attrs['plant']} plant, {result.attrs['controller']}"
    print(f"{what}: {end:g} s in {wall:.2f} s, {end / wall:.0f} x real time\n")
    print(table(figures))
    print(f"\nwritten to {folder}: result.nc, summary.json and figures")
    if len(result["time"]) > 1:  # otherwise nothing moves
        page = write_index(result, mission, truss, figures, folder, drawing=drawing)
        print(f"to look at it, open {page} in a browser")


def main(words: list[str] | None = None) -> int:
    """Run the command; errors that the user can mend are one line, not a traceback."""
    try:
        return fly(sys.argv[1:] if words is None else words)
    except TrussflowError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
