"""``python -m trussflow.models.transport``: simulate a mission and report its figures of merit."""

from __future__ import annotations

import argparse
import shlex
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from trussflow.blocks.errors import DivergenceError, SimulationInterrupted
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.results.dataset import save
from trussflow.blocks.simulation.adaptive import METHODS
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.blocks.support.files import replaced
from trussflow.blocks.support.progress import status_line
from trussflow.command_arguments import FAILED, Outcome, ended, json_of, parser_of
from trussflow.models.errors import ModelError
from trussflow.models.plant.space_truss import ARMS, STRUCTURES
from trussflow.models.transport.figures import draw
from trussflow.models.transport.index import write_index
from trussflow.models.transport.mission import CASES
from trussflow.models.transport.mission_file import (
    COMMAND,
    HARDWARE_KINDS,
    MEAN_AXES,
    MissionFile,
)
from trussflow.models.transport.results import check_run
from trussflow.models.transport.summary import summarize, table
from trussflow.models.transport.wiring import ALLOCATIONS, CONTROLLERS
from trussflow.models.viewer.panel import scene_panel

if TYPE_CHECKING:
    import xarray as xr

PROG = "python -m trussflow.models.transport"

RESULT_KEYS = {
    "plant": "structure.model",
    "attitude": "structure.attitude",
    "arm": "robots.arm",
    "controller": "controller.law",
}
"""Keys of the mission file for attributes of the result."""

STIFF_SOLVER = "Rodas5P"
"""Default solver for PD, whose fastest pole, k_d over the least inertia, is near 1e7 1/s."""


def parser(prog: str = PROG) -> argparse.ArgumentParser:
    """Return the argument parser of the command `prog`."""
    found = parser_of(
        prog,
        "Four space robots carry a flexible truss (Li, Wei, Chen 2026, section 4).",
        "--case 1                                # writes page, result, figures, summary to results/case1",
        "--case 2 --controller smc --duration 20 # first 20 s of Case 2, conventional sliding mode",
        "--plant consistent --allocation published   # unstable: the actuators do work on the modes",
        "--case 1 --live                         # also a page that repeats the run with other gains",
        "mission.toml --explain                  # print all values of a mission file with their sources",
        "--duration 5 --json                     # print figures of merit and provenance as JSON",
    )
    missions = found.add_mutually_exclusive_group()
    missions.add_argument(
        "mission",
        type=Path,
        nargs="?",
        help="mission file; 'trussflow new mission.toml' writes a template",
    )
    # The default is text: argparse would not notice `--case 1` beside a file if the default were equal.
    missions.add_argument(
        "--case",
        type=int,
        choices=CASES,
        default="1",
        help="mission of the paper; default: 1",
    )
    for flag, key, choices, about in (
        (
            "--plant",
            "structure.model",
            STRUCTURES,
            "model of the paper, exact equations, or also accurate at the grasp points",
        ),
        (
            "--arm",
            "robots.arm",
            tuple(ARMS),
            "arm: Table 2 as printed, or the Kinova JACO2",
        ),
        (
            "--controller",
            "controller.law",
            (*CONTROLLERS, MEAN_AXES),
            "integral sliding mode (the paper's), conventional sliding mode, PD, or mean axes",
        ),
        (
            "--observer",
            "controller.observer",
            ("on", "off"),
            "estimate the disturbance; by default only with ismc",
        ),
        (
            "--allocation",
            "controller.allocation",
            ALLOCATIONS,
            "Eq. 64, or feedback without work on the modes; the default depends on the plant",
        ),
        (
            "--hardware",
            "hardware.kind",
            HARDWARE_KINDS,
            "hardware between controller and truss",
        ),
        (
            "--solver",
            "simulation.solver",
            (*FIXED_STEP, *METHODS),
            f"default: rk4; for PD {STIFF_SOLVER}",
        ),
    ):
        found.add_argument(flag, dest=key, choices=choices, help=about)
    found.add_argument(
        "--infeasible",
        dest="path.infeasible",
        action="store_const",
        const="allowed",
        help="allow a path that is too fast for the actuators",
    )
    found.add_argument(
        "--duration",
        dest="simulation.duration",
        metavar="SECONDS",
        type=seconds,
        help="simulated time [s]; default: 80",
    )
    found.add_argument(
        "--step",
        dest="simulation.step",
        metavar="SECONDS",
        type=seconds,
        help="step of fixed-step solvers [s]",
    )
    found.add_argument(
        "--explain",
        action="store_true",
        help="print all values with their files, without a run",
    )
    found.add_argument(
        "--live",
        action="store_true",
        help="also write live.html, which simulates the mission in the browser, with sliders",
    )
    found.add_argument(
        "--output", type=Path, help="folder for result, summary and figures"
    )
    return found


def settings_of(options: argparse.Namespace) -> dict[str, dict[str, object]]:
    """Return the settings of `options` that override the mission file, by table."""
    settings: dict[str, dict[str, object]] = {}
    for name, value in vars(options).items():
        table, _, key = name.rpartition(".")
        if table and value is not None:
            settings.setdefault(table, {})[key] = value
    if settings.get("controller", {}).get("law") == "pd":
        settings.setdefault("simulation", {}).setdefault("solver", STIFF_SOLVER)
    return settings


def seconds(text: str) -> dict[str, object]:
    """Return a time of the command line as a value of a parameter file."""
    return {"value": float(text), "unit": "s", "source": COMMAND}


def simulate_mission(options: argparse.Namespace, command: str) -> Outcome:
    """Simulate the mission of the `options` of this `command`, and write all files."""
    settings = settings_of(options)
    mission = (
        MissionFile.of_case(options.case, **settings)
        if options.mission is None
        else MissionFile.read(options.mission, **settings)
    )
    if options.explain:
        return Outcome([each._asdict() for each in mission.told], mission.explained())
    name = f"case{options.case}" if options.mission is None else options.mission.stem
    folder = options.output or Path("results") / name
    live = folder / "live.html"
    try:  # before the run
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        live.unlink(missing_ok=True)  # of another mission, perhaps
    except OSError as error:
        raise ModelError(
            f"cannot write to the output folder '{folder}': {error}"
        ) from error
    diagram = mission.diagram()
    if options.live:  # also before the run: its messages are early
        write_live(mission, diagram, live)
    simulator = mission.simulator(diagram)
    failure, started = "", time.perf_counter()
    try:
        result = simulator.run(mission.duration)
    except (DivergenceError, SimulationInterrupted) as error:
        failure, result = str(error), cast("xr.Dataset", error.result)
    wall = time.perf_counter() - started
    result = result.assign_attrs(
        mission=mission.title,
        **{attribute: mission.said(key) for attribute, key in RESULT_KEYS.items()},
        observer=int("observer" in diagram.blocks),
        allocation="published" if "allocation" in diagram.blocks else "mode-neutral",
        command=command,
        target=mission.target.tolist(),
    )
    summary = report(
        check_run(result, mission.truss), mission, folder, wall, drawing=diagram.draw()
    )
    if failure:
        print(f"\n{failure}", file=sys.stderr)
    return Outcome(summary, code=FAILED if failure else 0)


def write_live(mission: MissionFile, diagram: Diagram, file: Path) -> None:
    """Write a page that simulates the mission, with the truss in motion."""
    if mission.solver != "rk4":
        raise ModelError(
            f"--live needs the solver rk4, not {mission.solver}: set --solver rk4 and a --step that "
            "is stable, or leave out --live"
        )
    scene = scene_panel(mission.truss, rods=mission.rods, target=mission.target)
    with status_line("compiling the live page"):
        diagram.live(
            file, duration=mission.duration, step=mission.mission.step, panels=[scene]
        )
    print(f"open {file} in a browser to change parameters", flush=True)


def report(
    result: xr.Dataset, mission: MissionFile, folder: Path, wall: float, *, drawing: str
) -> dict[str, Any]:
    """Write result, summary, figures and page, print the summary and return it."""
    save(result, folder / "result.nc")
    figures = summarize(result, mission.mission)
    summary = {"figures": [each._asdict() for each in figures], "run": result.attrs}
    with replaced(folder / "summary.json") as partial:
        partial.write_text(json_of(summary) + "\n", encoding="utf-8")
    end = float(result["time"][-1])
    what = (
        f"{mission.title}; {result.attrs['plant']} plant, {result.attrs['controller']}"
    )
    print(
        f"{what}: {end:g} s in {wall:.2f} s, {end / wall:.0f} x real time.{mission.cut}\n"
    )
    print(f"{table(figures)}\n", flush=True)
    if len(result["time"]) > 1:  # the replay needs two instants
        with status_line("writing the page"):
            page = write_index(result, mission, figures, folder, drawing=drawing)
        print(f"open {page} in a browser", flush=True)  # before the slow figures
    draw(result, folder)
    print(f"written to {folder}: result.nc, summary.json and figures")
    return summary


def main(words: list[str] | None = None, prog: str = PROG) -> int:
    """Run the command `prog` with `words`, by default those of the process; return the exit code."""
    words = sys.argv[1:] if words is None else words
    command = f"{prog} {shlex.join(words)}"
    return ended(
        lambda options: simulate_mission(options, command),
        parser(prog).parse_args(words),
    )


if __name__ == "__main__":
    sys.exit(main())
