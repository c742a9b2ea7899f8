"""Study of modes and control loops of the paper's truss at rest: tables.txt and figures in a folder.

``python examples/studies/modes/modes.py --quick`` takes two minutes; without ``--quick`` it covers more
modes, damping ratios and bandwidths.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
from spillover import rightmost_poles, truss_with
from study_tools.stability import draw_growth, stable_damping
from truss_loop import GROUPS, TrussLoop

from trussflow.blocks import modal_bode, modal_table
from trussflow.blocks.linear_analysis.loop_transfer import LoopMargins
from trussflow.blocks.linear_analysis.margins import Margins
from trussflow.models import RobotArm, SpaceTruss, TrussModes
from trussflow.models.dynamics.locked_joints import locked_frequencies, locked_inertia
from trussflow.models.reporting.figures import blank
from trussflow.models.reporting.tables import text_table
from trussflow.models.truss.natural_frequencies import natural_frequencies
from trussflow.models.truss.paper_truss import CLAMPED_FACE, paper_structure
from trussflow.models.truss.reduction import nearest

MODAL_DAMPING = 0.1
"""Damping ratio with which the truss of six modes is stable under Eq. 64 [-]."""

UNITS = {
    "crossover": "rad/s",
    "gain": "dB",
    "phase": "deg",
    "delay": "s",
    "frequency": "rad/s",
}
"""Units of margins; others have none."""


class Study:
    """Tables and figures; quick: fewer modes."""

    def __init__(self, folder: Path, *, quick: bool) -> None:
        self.folder, self.quick = folder, quick
        plants = {
            "published": SpaceTruss.published(),
            "consistent": SpaceTruss.consistent(),
        }
        self.loops = {
            f"{name}, {_observer(bandwidth)}": TrussLoop(plant, bandwidth)
            for (name, plant), bandwidth in product(plants.items(), (None, 4.0))
        }
        self.plants = plants

    def tables(self) -> Iterator[tuple[str, str]]:
        """Yield title and text of each table, and write the figures."""
        for clamped in (False, True):
            support = "clamped" if clamped else "free"
            yield (
                f"Natural frequencies, {support}, arms locked",
                self.frequencies(clamped=clamped),
            )
        yield (
            "Modes of the consistent plant, arms free",
            str(modal_table(self.plants["consistent"], "actuation")),
        )
        for name, loop in self.loops.items():
            yield (
                f"Margins at the demand, others closed: {name}",
                self.demand_margins(loop),
            )
        for damping, bandwidth in product((0.005, MODAL_DAMPING), (None, 4.0)):
            loop = TrussLoop(
                SpaceTruss.consistent(damping=damping),
                bandwidth,
                allocation="published",
            )
            file = self.folder / f"bode_{1000 * damping:g}_{bandwidth or 0:g}.png"
            bode = modal_bode(loop.diagram, "truss.modal_force", loop=loop.modal_loop)
            bode.savefig(file)
        for name, loop in self.linear_loops().items():
            yield (
                f"Modes of the closed loop, linear law: {name}",
                str(modal_table(loop.diagram, "truss.actuation")),
            )
        yield (
            "Spillover: least damping from which on the loop is stable, linear law",
            self.spillover(),
        )

    def frequencies(self, *, clamped: bool) -> str:
        """Compare truncated modes, and modes with attachment shapes, with all finite elements."""
        structure, arm, face = paper_structure(), RobotArm.literal(), CLAMPED_FACE
        grasps = TrussModes.reconstructed().grasp_positions
        nodes = [nearest(structure.positions, grasp) for grasp in grasps]
        bodies = {node + 1: locked_inertia(arm, arm.rest_angles) for node in nodes}
        held = {"clamped": face} if clamped else {"rigid": face}
        exact = natural_frequencies(structure, 6, bodies, **held)
        rows = [["finite elements [Hz]", *(f"{f:.4f}" for f in exact)]]
        for number, shapes in product((6, 14, 40), (False, True)):
            dynamics = truss_with(number, attachments=shapes).dynamics
            errors = locked_frequencies(dynamics, clamped=clamped)[:6] / exact - 1
            name = f"{number} modes" + " and attachment shapes" * shapes
            rows.append([name, *(f"{round(100 * e, 3) + 0.0:.3f} %" for e in errors)])
        return text_table(["error", *(f"f{k + 1}" for k in range(6))], rows)

    def demand_margins(self, loop: TrussLoop) -> str:
        """Return margins of the pose and of the weakest joint of each robot, and of groups at once."""
        found = {name: loop.margins(group) for name, group in GROUPS.items()}
        single, *joints = [found[name].channels.values() for name in list(GROUPS)[2:]]
        channels = [*single, *(min(own, key=lambda m: m.disk) for own in joints)]
        return f"{_table(channels)}\n\n{_table(found.values(), index=found)}"

    def linear_loops(self) -> dict[str, TrussLoop]:
        """Return loops with linear laws by name."""
        undamped = SpaceTruss.consistent(damping=0.0)
        loops = {
            f"Eq. 64 with modal work, undamped, {_observer(bandwidth)}": TrussLoop(
                undamped, bandwidth, allocation="published", linear=True
            )
            for bandwidth in (None, 2.0, 4.0)
        }
        return loops | {
            f"{name}, L = 4": TrussLoop(plant, 4.0, linear=True)
            for name, plant in self.plants.items()
        }

    def spillover(self) -> str:
        """Return the map of spillover over number of modes, damping and bandwidth."""
        ratios = (
            (0.0, 0.005, 0.02) if self.quick else (0.0, 0.0025, 0.005, 0.01, 0.02, 0.05)
        )
        bandwidths = (0.0, 2.0, 4.0) if self.quick else (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)
        numbers = (14,) if self.quick else (6, 10, 14, 20, 30)
        figure, plots = blank(len(numbers), 3, width=12)
        rows: list[list[str]] = []
        for number in numbers:
            found = rightmost_poles(truss_with(number), ratios, bandwidths)
            for name, poles in found.items():
                draw_growth(
                    plots[len(rows)],
                    poles.real,
                    [f"{L:g}" for L in bandwidths],
                    [f"{100 * ratio:g}" for ratio in ratios],
                    title=f"{name}, {number} modes: growth rate [1/s]",
                    xlabel="L [1/s]",
                    ylabel="damping [%]",
                )
                least = [stable_damping(rates, ratios) for rates in poles.real.T]
                rows.append(
                    [name, str(number), *(f"{100 * each:g} %" for each in least)]
                )
        figure.savefig(self.folder / "spillover.png")
        return text_table(["loop", "modes", *(f"L = {L:g}" for L in bandwidths)], rows)


def _observer(bandwidth: float | None) -> str:
    return "no observer" if bandwidth is None else f"L = {bandwidth:g}"


def _table(margins: Iterable[Margins | LoopMargins], **options: Any) -> str:
    """Return margins as a table, with further `options` of `pandas.DataFrame`."""
    frame = pd.DataFrame(map(asdict, margins), **options).drop(
        columns="channels", errors="ignore"
    )
    heads = {name: f"{name} [{unit}]" for name, unit in UNITS.items()}
    return str(frame.rename(columns=heads).to_string(float_format="{:.3g}".format))


def main(words: Sequence[str] | None = None) -> None:
    """Write tables and figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer modes")
    parser.add_argument(
        "--output", type=Path, default=Path("results/modes"), help="folder to write to"
    )
    options = parser.parse_args(words)
    options.output.mkdir(parents=True, exist_ok=True)
    with (options.output / "tables.txt").open("w", encoding="utf-8") as file:
        for title, table in Study(options.output, quick=options.quick).tables():
            print(f"{title}\n\n{table}\n", flush=True)
            file.write(f"{title}\n\n{table}\n\n")


if __name__ == "__main__":
    main()
