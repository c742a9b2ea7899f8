"""What the source leaves out, how it was filled, and what speaks for that."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from study_tools.ledger import Ledger

from reproduction.context import Context
from reproduction.measures import TORQUE_BOUNDS, force_shares
from reproduction.results import Results
from reproduction.trusses import PRINTED_MODES, frame_modes
from trussflow.models.reporting.metrics import largest_component as peak
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.transport.mission import CASES
from trussflow.models.truss.paper_truss import frame_parameters, paper_frame, printed_frequencies

RUNS = tuple(
    f"case{case}{suffix}"
    for case in CASES
    for suffix in ("", "-mounting", "-centroid-at-joint", "-other-side", "-inner-edge", "-pd")
)


def section(context: Context) -> str:
    """Return the section of the report."""
    results, ledger = context.results, context.ledger
    rows: Sequence[Sequence[str]] = (
        (
            "truss layout, mode shapes, P, H, S, J",
            "L of two rows of box modules of solid aluminium rod, no diagonals, first frame "
            f"clamped: {_layout(ledger)} (`models/truss/paper_truss.py`, "
            "`parameters/space_truss.toml`)",
            _frame(ledger, results.folder),
        ),
        ("which longeron carries the grasp points", "the outer one of the bend", _longeron(results, ledger)),
        (
            "side of the truss on which the robots are",
            "truss at z > 0: the arms of Table 2 hang towards −z, and their bases would be inside "
            "the truss otherwise",
            "no frequency tells the sides apart; " + _torques(context, "-other-side", "on the other side"),
        ),
        (
            "links' centres of mass",
            "those of the Kinova JACO2, which the printed masses and inertias belong to "
            "(`tests/models/robots/test_robot_arm.py`)",
            _arm(ledger),
        ),
        (
            "rotation convention of Table 2",
            "R = Rx Ry Rz about moving axes, child to parent",
            "the source's own attitude matrix (Eq. 44) follows this habit; six printed rows are "
            "rotations of the Kinova description only so, one row late",
        ),
        (
            "what J of a link refers to",
            "its frame origin C_{i,j}, not its centre of mass",
            "the printed inertias are those of the description's cylinders only so "
            "(`test_printed_inertias_are_those_of_the_description_s_cylinders`)",
        ),
        (
            "r of O_i in O_{i,7} and of O_ci in O_i; what J_i refers to",
            "base frame at the last joint, centroid half the height of the box with the printed "
            "inertia away, J_i about the centroid",
            _mounting(context),
        ),
        ("PD law", "u = −k_p e − k_d ė on all 34 channels as printed, in task axes", _pd(context)),
        (
            "SMC of the comparison",
            "without observer and without boundary layer, as its formula reads",
            "runs with the observer stand beside it in the claims table",
        ),
        (
            "start of the observer",
            "z(0) = −L x₂(0), an estimate of zero",
            "the only start that needs no knowledge of the disturbance",
        ),
        (
            "work of the actuators on the modes",
            "Eq. 42 has it; left out in `published`",
            "with it the published loop is unstable: see *Instability with modal actuation*",
        ),
        ("structural damping", "none", "the source has no damping term in Eqs. 27 to 30"),
    )
    return markdown_table(("left out", "filled with", "support"), rows)


def _frame(ledger: Ledger, folder: Path) -> str:
    worst = _frequency_error("reconstructed", folder)
    density = paper_frame().members[0].density / (np.pi * frame_parameters()["rod_radius"] ** 2)
    return (
        "without any fitted number all six frequencies of Table 1 come out within "
        + ledger("truss: largest frequency error", worst, "%", digits=2)
        + ", and the printed mass gives a density of "
        + ledger("truss: density", density, "kg/m^3", digits=5)
        + ", that of aluminium; Robot 3's idleness and the bound on the torques in Case 1 come out "
        "without having been used"
    )


def _layout(ledger: Ledger) -> str:
    frame = frame_parameters()
    first = ledger.count("truss: modules of the first arm", int(frame["first_arm_modules"]))
    second = ledger.count("truss: modules of the second arm", int(frame["second_arm_modules"]))
    rod = ledger("truss: diameter of the rods", 2 * frame["rod_radius"], "m", digits=2)
    return f"{first} and {second} modules, rods of {rod}"


def _longeron(results: Results, ledger: Ledger) -> str:
    error = _frequency_error("inner edge", results.folder)
    share = force_shares(results["case1-inner-edge"])[2]
    return (
        "on the inner longeron the frequencies are off by up to "
        + ledger("truss, inner edge: largest frequency error", error, "%", digits=2)
        + ", and Robot 3 carries "
        + ledger.of("case1-inner-edge")("share of Robot 3", share, "%", digits=2)
        + " in Case 1, where the source says nearly nothing"
    )


def _frequency_error(variant: str, folder: Path) -> float:
    found = frame_modes(variant, folder).frequencies[:PRINTED_MODES]
    return float(np.abs(found / printed_frequencies() - 1).max())


def _arm(ledger: Ledger) -> str:
    literal, jaco = RobotArm.literal(), RobotArm.jaco()
    printed, true = (np.array([np.diag(j) for j in arm.inertias]) for arm in (literal, jaco))
    off = float(np.abs(printed - true).max())
    return (
        "the true inertias differ from the printed ones by at most "
        + ledger("arm: largest difference of inertias", off, "kg*m^2", digits=2)
        + ", and that is explained by a slip: link tensors not rotated before the parallel-axis "
        "term"
    )


def _peaks(context: Context, suffix: str, variable: str, unit: str) -> list[str]:
    """Return the peaks of a variable in both cases."""
    runs = [f"case{case}{suffix}" for case in CASES]
    name = f"peak {variable.replace('_', ' ')}"
    return [context.ledger.of(run)(name, peak(context.results[run][variable]), unit) for run in runs]


def _torques(context: Context, suffix: str, words: str) -> str:
    shown = _peaks(context, suffix, "base_torque", "N*m")
    return f"{words} the base torques peak at {shown[0]} and {shown[1]} in Cases 1 and 2"


def _mounting(context: Context) -> str:
    bounds = [
        context.ledger(f"claim: torque in Case {case}", bound, "N*m", digits=2)
        for case, bound in TORQUE_BOUNDS.items()
    ]
    parts = (
        _torques(context, "", "so"),
        _torques(context, "-mounting", "with the Kinova's mounting height added"),
        _torques(context, "-centroid-at-joint", "with the centroid in the joint"),
        f"the source has {' and '.join(bounds)}",
    )
    return "; ".join(parts)


def _pd(context: Context) -> str:
    shown = _peaks(context, "-pd", "attitude_error", "rad")
    return (
        "its fastest pole, k_d over the least inertia of a joint, is far too fast for the source's "
        f"step of a millisecond; solved with LSODA. It errs by up to {shown[0]} and {shown[1]}, "
        "which agrees with the source's words"
    )
