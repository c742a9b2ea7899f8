"""Report: simulates all runs, computes its numbers, and writes text, figures and evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr
from study_tools.evidence import fingerprint, write_report
from study_tools.ledger import Ledger

from reproduction import claims, instability, measures, slow_mode
from reproduction.figures import draw_paper_figures, draw_theorems
from reproduction.frames import draw_frames, link_frames
from reproduction.report_numbers import TABLES, Numbers
from reproduction.runs import (
    BANDWIDTH_RUNS,
    RUNS,
    changes,
    measure_all,
    mission,
    simulator,
)
from reproduction.trusses import PRINTED_MODES, frame_modes
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.progress import counted, status_line
from trussflow.blocks.tracing.kernels import symbol, to_expression
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.transport.mission import CASES, Mission
from trussflow.models.transport.results import check_run, logged
from trussflow.models.truss.paper_truss import (
    frame_parameters,
    paper_frame,
    printed_frequencies,
)
from trussflow.models.truss.truss_modes import TrussModes

RK4_LIMIT = 2.785
"""Largest product of step and pole on the negative real axis for which RK4 is stable [-]."""
RUN_DURATION = 80.0
"""Simulated time [s]: 60 s of motion and 20 s of hold, as in the figures of the paper."""

MISSIONS = {case: Mission.of_case(case) for case in CASES}
THEOREM_RUNS = ("case1", "case2", "case1-pushed", "case2-pushed")
OBSERVER_RUNS = tuple(
    f"case{case}{suffix}" for case in CASES for suffix in ("", "-no-observer")
)
COMPUTED_MODES = ("-inner-edge", "-12-modes", "-20-modes")
"""Suffixes of runs with computed modes, which have no fingerprint: computing them takes a minute."""


def fingerprints(folder: Path) -> dict[str, list[float]]:
    """Return the fingerprints of all diagrams with shipped modes.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the computed modes.
    """
    loops = {
        f"stability {'with' if observer else 'without'} observer": (
            instability.holding_loop(folder, PRINTED_MODES, observer),
            1e-3,
        )
        for observer in (False, True)
    }
    for run in RUNS:
        if not run.endswith(COMPUTED_MODES):
            file = mission(run, folder)
            loops[run] = file.diagram(), file.mission.step
    return {
        name: fingerprint(Simulator(loop, log=logged(loop), step=step, backend="numpy"))
        for name, (loop, step) in counted("comparing loops", loops.items())
    }


def reproduce(output: Path, folder: Path, *, workers: int) -> Path:
    """Simulate the missing runs, write the report, and return its file.

    Parameters
    ----------
    output : pathlib.Path
        Folder of the report.
    folder : pathlib.Path
        Folder of the finished runs.
    workers : int
        Number of processes [-].
    """
    for variant in ("reconstructed", "inner edge"):
        frame_modes(variant, folder)  # before processes compute them at the same time
    found = measure_all(RUNS, RUN_DURATION, folder, workers=workers)
    with status_line("computing the stability map"):
        maps = instability.stability_map(folder, workers=workers)

    @cache
    def result(run: str) -> xr.Dataset:
        raw = simulator(folder, run).run(found[run]["duration"], progress=False)
        return check_run(raw, mission(run, folder).truss)

    poles = {
        run: slow_mode.predicted_poles(run, found[run], folder) for run in OBSERVER_RUNS
    }
    output.mkdir(parents=True, exist_ok=True)
    draw_frames(output / "figure-02.png")
    figures = draw_paper_figures(result, output)
    bounds = {
        run: (found[run]["bound of Theorem 1"], found[run]["ultimate bound of V"])
        for run in THEOREM_RUNS
    }
    draw_theorems(result, bounds, output / "theorems.png")
    slow_mode.draw_late_errors(result, poles, output / "late-errors.png")
    instability.draw_stability(maps, output / "stability.png")
    numbers = (
        complete(found, poles)
        | instability.stability_measures(maps)
        | shipped_data(folder)
    )
    return write(numbers, figures, fingerprints(folder), output)


def complete(
    found: Mapping[str, Mapping[str, Any]], poles: Mapping[str, Any]
) -> dict[str, dict[str, Any]]:
    """Return the measures of all runs with those that need a mission, the predicted poles, or two runs.

    Parameters
    ----------
    found : mapping
        Measures of each run.
    poles : mapping
        Poles by `slow_mode.predicted_poles`, keyed by the run [1/s].
    """
    numbers: dict[str, dict[str, Any]] = {
        run: dict(values) for run, values in found.items()
    }
    for run, own in numbers.items():
        case = int(run[4])
        way = np.abs(MISSIONS[case].position).max()
        bound = measures.TORQUE_BOUNDS[case]
        of = " of Robot 4" if case == 1 else ""  # the claim on Case 1 is about Robot 4
        own |= {
            "commanded displacement": way,
            "commanded angle": np.abs(MISSIONS[case].attitude).max(),
            "peak position error per displacement": own["peak position error"] / way,
            "torque bound": bound,
            "claimed base torque": own[f"peak base torque{of}"],
            "claimed joint torque": own[f"peak joint torque{of}"],
            "claimed torque": own[f"largest torque{of}"],
            "time of the claimed torque": own[f"time of the largest torque{of}"],
            "excess over the torque bound": own[f"largest torque{of}"] / bound - 1,
        }
    for run, values in poles.items():
        usual = values[list(slow_mode.SCALES).index(1.0)]
        numbers[run]["predicted growth of mode 1"] = usual.real
        numbers[run]["predicted frequency of mode 1"] = usual.imag
        limit = slow_mode.limit_cycle(values.real) * numbers[run]["late position error"]
        numbers[run]["predicted limit cycle"] = limit
    return numbers | claims.advantages(numbers)


def shipped_data(folder: Path) -> dict[str, dict[str, float]]:
    """Return the numbers of the reconstructed truss and arm, and the criteria.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the computed modes.
    """
    frame, modes = frame_parameters(), TrussModes.reconstructed()
    distances = np.linalg.norm(
        (modes.grasp_positions - modes.static_moment / modes.mass)[:, :2], axis=1
    )
    printed, true = (
        np.array([np.diag(J) for J in arm.inertias])
        for arm in (RobotArm.literal(), RobotArm.jaco())
    )
    truss = {
        "modules of the first arm": int(frame["first_arm_modules"]),
        "modules of the second arm": int(frame["second_arm_modules"]),
        "diameter of the rods": 2 * frame["rod_radius"],
        "density": paper_frame().members[0].density
        / (np.pi * frame["rod_radius"] ** 2),
        "largest frequency error": _frequency_error("reconstructed", folder),
        "largest frequency error, inner edge": _frequency_error("inner edge", folder),
        **{f"distance of grasp {i}": float(d) for i, d in enumerate(distances, 1)},
    }
    criterion = {
        "small": claims.SMALL_PART,
        "notable": claims.NOTABLE_FACTOR,
        "nearly nothing": claims.IDLE_SHARE,
        "most": claims.MOST_SHARE,
        "smooth": claims.SMOOTH_CHANGE,
        "late part": measures.LATE_FRACTION,
        "ripple window": measures.RIPPLE_WINDOW,
        "step": MISSIONS[1].step,
    }
    arm = {"largest difference of inertias": float(np.abs(printed - true).max())}
    return {
        "truss": truss,
        "criterion": criterion,
        "arm": arm,
        "plant": plant_measures(),
    }


def plant_measures() -> dict[str, float]:
    r"""Return numbers of the equations of motion at the initial state.

    The modes accelerate by :math:`-M_{ff}^{-1} M_{fr} \ddot q_r`, so the disturbance has the part
    :math:`-(1 - K)^{-1} K \hat d` with :math:`K = G^{-1} M_{rf} M_{ff}^{-1} M_{fr}`. The poles of the
    observer are therefore :math:`-L / (1 - k)` for the eigenvalues k of K.
    """
    published, consistent = (
        plant.dynamics for plant in (SpaceTruss.published(), SpaceTruss.consistent())
    )
    n, terms = published.rigid_freedoms, published.evaluate(published.rest)
    mass = np.asarray(terms.mass_matrix)
    coupling = np.linalg.solve(mass[n:, n:], mass[n:, :n])
    shares = np.linalg.eigvals(np.linalg.solve(mass[:n, :n], mass[:n, n:]) @ coupling)
    fastest = 1.0 / (1.0 - shares.real.max())
    joints = link_frames(published, 1)[1:-1]
    screws = [[*np.cross(origin, axes[:, 2]), *axes[:, 2]] for origin, axes in joints]
    return {
        "fastest pole per L": fastest,
        "largest L for the paper's step": RK4_LIMIT / (fastest * MISSIONS[1].step),
        "rank of the arms": int(np.linalg.matrix_rank(screws, tol=1e-9)),
        "operations": operations(published),
        "operations with exact integrals": operations(consistent),
    }


def operations(dynamics: TrussDynamics) -> int:
    """Return the number of operations of mass matrix, bias and actuation matrix."""
    q, v = symbol("q", (dynamics.coordinates,)), symbol("v", (dynamics.freedoms,))
    terms = dynamics.evaluate(q, v)
    outputs = [
        to_expression(np.ravel(term))
        for term in (terms.mass_matrix, terms.bias, terms.actuation_matrix)
    ]
    arguments = [to_expression(q), to_expression(v)]
    return int(ca.Function("terms", arguments, outputs, {"cse": True}).n_instructions())


def _frequency_error(variant: str, folder: Path) -> float:
    found = frame_modes(variant, folder).frequencies[:PRINTED_MODES]
    return float(np.abs(found / printed_frequencies() - 1).max())


def write(
    numbers: Mapping[str, Mapping[str, Any]],
    figures: str,
    recorded: Mapping[str, Sequence[float]],
    output: Path,
) -> Path:
    """Write the text of the report and its evidence; return the file of the text.

    Parameters
    ----------
    numbers : mapping
        All numbers, keyed by run or subject and by name.
    figures : str
        Part of the report with the figures of the paper.
    recorded : mapping
        Result of `fingerprints`.
    output : pathlib.Path
        Folder of the report.
    """
    ledger = Ledger()
    rows = claims.table_of_claims(numbers, ledger)
    counts = {
        word: sum(word in row["verdict"].split("**") for row in rows)
        for word in claims.VERDICTS
    }
    n = Numbers({**numbers, "claims": {"all": len(rows), **counts}}, ledger)
    loops = {
        f"stability of case {case} {kind} observer": f"Case {case}, {kind} observer"
        for case in CASES
        for kind in ("without", "with")
    }
    columns = TABLES["columns"]
    parts = {
        "table of claims": markdown_table(
            tuple(rows[0]), [tuple(row.values()) for row in rows]
        ),
        "figures": figures,
        **{
            f"table of {what}": n.table(
                "run", {run: f"`{run}`" for run in runs}, columns[what]
            )
            for what, runs in (
                ("Theorem 1", THEOREM_RUNS),
                ("Theorem 2", THEOREM_RUNS),
                ("bandwidths", BANDWIDTH_RUNS),
                ("late errors", OBSERVER_RUNS),
            )
        },
        "verdict on the theorems": verdict_on_theorems(n),
        "table of stability": n.table(
            "gains and observer", loops, columns["stability"]
        ),
        "table of runs": markdown_table(
            ("run", "changed values"), [(f"`{run}`", changes(run)) for run in RUNS]
        ),
    }
    for case in CASES:
        labels = {
            (run := f"case{case}{suffix}"): f"{meaning}{_changed_verdicts(n, run)}"
            for suffix, meaning in TABLES["variants"].items()
        }
        parts[f"table of Case {case}"] = n.table(
            f"Case {case}", labels, columns["sensitivity"]
        )
    text = n.filled(
        Path(__file__).with_name("report_template.txt").read_text(encoding="utf-8")
    )
    for name, part in parts.items():
        text = text.replace(f"{{{name}}}", part)
    return write_report(output, text, ledger, recorded, claims=rows)


def outcomes(n: Numbers, run: str) -> dict[str, bool]:
    """Return which of the main claims of the paper hold in a run, by subject.

    Parameters
    ----------
    n : Numbers
        Numbers of the report.
    run : str
        Name of the run.
    """
    case = int(run[4])
    own = Numbers(n.measures, n.ledger, run.removeprefix("case"))
    found = {
        subject: claims.verdict(subject, own) == claims.REPRODUCED
        for subject in TABLES["main_claims"][run[:5]]
    }
    within = n[f"{run}: largest torque"] <= measures.TORQUE_BOUNDS[case]
    return found | {"bound on the torques": within}


def _changed_verdicts(n: Numbers, run: str) -> str:
    """Return the claims that hold in one of a run and the usual run only, as text."""
    usual, found = outcomes(n, run[:5]), outcomes(n, run)
    changed = [
        f"{subject}: {'holds' if holds else 'fails'}"
        for subject, holds in found.items()
        if holds != usual[subject]
    ]
    return f" (**{'; '.join(changed)}**)" if changed else ""


def verdict_on_theorems(n: Numbers) -> str:
    """Return the verdict on both theorems as text.

    Parameters
    ----------
    n : Numbers
        Numbers of the report.
    """

    def all_runs(name: str, least: float, largest: float = np.inf) -> bool:
        return all(least <= n[f"{run}: {name}"] <= largest for run in THEOREM_RUNS)

    holds = {True: "holds in every run", False: "is violated"}
    falls = all_runs("instants at which V rises though it must fall", 0, 0)
    sentences = [
        f"The bound of Theorem 1 {holds[all_runs('slack of Theorem 1', 1)]}.",
        f"σ > J̄²/L {holds[all_runs('slack of sigma', 1)]}.",
        f"Where the proof requires V to fall, it {'always' if falls else 'does not always'} "
        f"fall{'s' if falls else ''}, and V̇ ≤ −ρV + ‖ḋ‖²/2L "
        f"{holds[all_runs('largest part of the bound on the slope', -np.inf, 1)]}.",
    ]
    if all_runs("time of V above its bound", 0, 0):
        sentences.append(
            "V never reaches its ultimate bound, not even after the push: that V decreases outside it is "
            "true, but empty. The inequality of the proof, with ‖ḋ‖ of the same instant in place of ξ, is "
            "sharper; the last three columns check it."
        )
    return " ".join(sentences)
