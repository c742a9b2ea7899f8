"""Study of modes and control loops of the paper's truss at rest: tables.txt and figures in a folder.

``python examples/studies/modes/modes.py --quick`` takes two minutes; without ``--quick`` it covers more
modes, damping ratios and bandwidths.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from spillover import least_damping, state_matrices, truss_with
from truss_loop import CHANNELS, GROUPS, ROBOTS, TrussLoop

from trussflow.blocks import modal_bode, modal_table
from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.linear_analysis.loop_transfer import margins_of
from trussflow.blocks.linear_analysis.margins import Margins
from trussflow.models import RobotArm, SpaceTruss, TrussDynamics, TrussModes
from trussflow.models.dynamics.locked_joints import locked_frequencies, locked_inertia
from trussflow.models.reporting.figures import blank, draw_cells
from trussflow.models.reporting.tables import text_table
from trussflow.models.truss.natural_frequencies import natural_frequencies
from trussflow.models.truss.paper_truss import CLAMPED_FACE, paper_structure
from trussflow.models.truss.reduction import nearest, reduced_modes

MODAL_DAMPING = 0.1
"""Damping ratio with which the truss of six modes is stable under Eq. 64 [-]."""

MARGINS = [
    "channel",
    "crossover [rad/s]",
    "gain down [dB]",
    "gain up [dB]",
    "phase [deg]",
    "delay [ms]",
    "disk",
]
POLES = [
    "pole [1/s]",
    "damping",
    "translation",
    "rotation",
    "joints",
    "modes",
    "controller",
    "mode",
]
SHOWN_CHANNELS = ["x", "y", "z", "phi", "theta", "psi", "theta_4_1"]


class Study:
    """Tables and figures; quick: fewer modes and frequencies."""

    def __init__(self, folder: Path, *, quick: bool) -> None:
        self.folder, self.quick = folder, quick
        self.points = 300 if quick else 600
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
        self.draw_demand_loops()
        for damping, bandwidth in product((0.005, MODAL_DAMPING), (None, 4.0)):
            loop = TrussLoop(
                SpaceTruss.consistent(damping=damping),
                bandwidth,
                allocation="published",
            )
            file = self.folder / f"bode_{1000 * damping:g}_{bandwidth or 0:g}.png"
            modal_bode(loop.diagram, "truss.modal_force", loop=loop.modal_loop).savefig(
                file
            )
            yield (
                f"Loops at the modal forces: Eq. 64, {100 * damping:g} %, {_observer(bandwidth)}",
                self.modal_margins(loop),
            )
        yield from self.poles()
        yield (
            "Spillover: least damping from which on the loop is stable, linear law",
            self.spillover(),
        )
        yield (
            "Delay and sample time of stable loops, the same in all channels",
            self.timing(),
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
        for number, shapes in product(
            (6, 14) if self.quick else (6, 10, 14, 20, 40), (False, True)
        ):
            modes = reduced_modes(
                structure, number, list(grasps), clamped=face, attachments=shapes
            )
            dynamics = TrussDynamics(
                modes=modes, arms=(arm,) * ROBOTS, elastic_integrals=True
            )
            errors = locked_frequencies(dynamics, clamped=clamped)[:6] / exact - 1
            name = f"{number} modes" + " and attachment shapes" * shapes
            rows.append([name, *(f"{round(100 * e, 3) + 0.0:.3f} %" for e in errors)])
        return text_table(["error", *(f"f{k + 1}" for k in range(6))], rows)

    def demand_margins(self, loop: TrussLoop) -> str:
        """Return margins of the pose and of the weakest joint of each robot, and of groups at once."""
        found = {
            name: loop.margins(group, self.points) for name, group in GROUPS.items()
        }
        single, *joints = [found[name].channels.values() for name in list(GROUPS)[2:]]
        channels = [*single, *(min(own, key=lambda m: m.disk) for own in joints)]
        groups = [
            [
                name,
                f"{m.disk:.2f}",
                f"±{m.gain:.1f}",
                f"±{m.phase:.0f}",
                f"{m.frequency:.3g}",
            ]
            for name, m in found.items()
        ]
        header = [
            "all at the same time",
            "disk",
            "gain [dB]",
            "phase [deg]",
            "least at [rad/s]",
        ]
        return f"{text_table(MARGINS, [_row(m) for m in channels])}\n\n{text_table(header, groups)}"

    def modal_margins(self, loop: TrussLoop) -> str:
        """Return the margins at each modal force, or the unstable poles."""
        try:
            found = margins_of(loop.modal_loop, loop.omega(points=self.points)).channels
        except LinearAnalysisError as error:
            return str(error)
        return text_table(MARGINS, [_row(m) for m in found.values()])

    def draw_demand_loops(self) -> None:
        """Draw the loop gain of some channels of the demand."""
        figure = Figure(figsize=(16, 4), layout="constrained")
        for axes, (name, loop) in zip(
            figure.subplots(1, 4, sharey=True), self.loops.items(), strict=True
        ):
            omega = loop.omega()
            gains = loop.gains(loop.demand_loop, omega)
            for channel in SHOWN_CHANNELS:
                gain = 20 * np.log10(np.abs(gains[:, CHANNELS.index(channel)]))
                axes.semilogx(omega / (2 * np.pi), gain, label=channel)
            axes.set(
                title=name,
                xlabel="frequency [Hz]",
                ylabel="loop gain [dB]",
                ylim=(-80, 120),
            )
        axes.legend(fontsize="small")
        figure.savefig(self.folder / "bode_demand.png")

    def poles(self) -> Iterator[tuple[str, str]]:
        """Yield the rightmost oscillating poles of linear laws."""
        undamped = SpaceTruss.consistent(damping=0.0)
        loops = {
            f"Eq. 64 with modal work, undamped, {_observer(bandwidth)}": TrussLoop(
                undamped, bandwidth, allocation="published", linear=True
            )
            for bandwidth in (None, 2.0, 4.0)
        }
        loops |= {
            f"{name}, L = 4": TrussLoop(plant, 4.0, linear=True)
            for name, plant in self.plants.items()
        }
        figure = Figure(figsize=(7, 6), layout="constrained")
        axes = figure.subplots()
        for name, loop in loops.items():
            values = np.linalg.eigvals(loop.closed)
            near = values[(values.imag > 0.1) & (values.real > -20)]
            axes.plot(near.real, near.imag, "o", fillstyle="none", label=name)
            header = [*POLES, "channels that drive it right [1/s]"]
            yield (
                f"Poles, linear law: {name}",
                text_table(header, loop.poles(3 if self.quick else 5)),
            )
        axes.set(
            xlabel="real part [1/s]",
            ylabel="imaginary part [rad/s]",
            title="poles of the closed loop",
        )
        axes.legend(fontsize="small")
        figure.savefig(self.folder / "poles.png")

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
            for name, loop in state_matrices(truss_with(number)).items():
                growth = loop.growth(ratios, bandwidths)
                plot = plots[len(rows)]
                limit = 1.5 * np.abs(growth).max()  # so that black numbers are readable
                labels = (
                    [f"{L:g}" for L in bandwidths],
                    [f"{100 * ratio:g}" for ratio in ratios],
                )
                draw_cells(
                    plot,
                    growth,
                    "{:+.2f}".format,
                    lambda _: False,
                    *labels,
                    vmin=-limit,
                    vmax=limit,
                )
                plot.set(
                    title=f"{name}, {number} modes: growth rate [1/s]",
                    xlabel="L [1/s]",
                    ylabel="damping [%]",
                )
                rows.append(
                    [
                        name,
                        str(number),
                        *(least_damping(rates, ratios) for rates in growth.T),
                    ]
                )
        figure.savefig(self.folder / "spillover.png")
        return text_table(["loop", "modes", *(f"L = {L:g}" for L in bandwidths)], rows)

    def timing(self) -> str:
        """Return largest delays and sample times, without and with a computing time of one period."""
        loops = dict(self.loops)
        for (name, plant), controller in product(self.plants.items(), ("smc", "pd")):
            loops[f"{name}, {controller}"] = TrussLoop(plant, controller=controller)
        rows = [
            [name, *loop.timing(25 if self.quick else 50)]
            for name, loop in loops.items()
        ]
        header = [
            "loop",
            "delay [ms]",
            "oscillates at [rad/s]",
            "period [ms]",
            "period, one to compute [ms]",
        ]
        return text_table(header, rows)


def _observer(bandwidth: float | None) -> str:
    return "no observer" if bandwidth is None else f"L = {bandwidth:g}"


def _row(m: Margins) -> list[str]:
    gains = [
        20 * np.log10(gain) if gain > 0 else -np.inf
        for gain in (m.gain_down, m.gain_up)
    ]
    numbers = [m.crossover, *gains, m.phase, 1e3 * m.delay, m.disk]
    forms = (".3g", ".1f", ".1f", ".1f", ".3g", ".2f")
    cells = [
        f"{v:{form}}" if np.isfinite(v) else "-"
        for v, form in zip(numbers, forms, strict=True)
    ]
    return [m.channel, *cells]


def main(words: Sequence[str] | None = None) -> None:
    """Write tables and figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="fewer modes and frequencies"
    )
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
