"""How each statement of the source is judged."""

from __future__ import annotations

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger

from reproduction.claims import (
    COARSE,
    MOST,
    NEARLY_NOTHING,
    NOTABLE,
    OPEN,
    REPRODUCED,
    SMALL,
    SMOOTH,
    Judge,
    Judgement,
    judge_by,
    verdict,
)
from reproduction.measures import (
    TORQUE_BOUNDS,
    error_size,
    force_shares,
    largest_jump,
    late,
    norm,
    of_robot,
    ripple,
)
from reproduction.results import Results
from trussflow.models.reporting.metrics import largest_component as peak


def tracking(run: str, settles: bool) -> Judge:
    """Judge the errors of a `run`, which are small and, if the source says that it `settles`, settle."""

    @judge_by(run)
    def judge(results: Results, ledger: Ledger) -> Judgement:
        mission, result = results.mission(run), results[run]
        n = ledger.of(run)
        way, turn = np.abs(mission.position).max(), np.abs(mission.attitude).max()
        end = late(result)
        errors = peak(result.position_error), peak(result.attitude_error)
        last = peak(end.position_error), peak(end.attitude_error)
        ours = (
            f"peak {n('peak position error', errors[0], 'm')}, "
            f"{n('peak attitude error', errors[1], 'rad')}; "
            f"late {n('late position error', last[0], 'm')}, "
            f"{n('late attitude error', last[1], 'rad')}"
        )
        small = errors[0] < SMALL * way and errors[1] < SMALL * (turn or 1.0)
        holds = small and (not settles or (last[0] < errors[0] and last[1] < errors[1]))
        part = n("peak position error per way", errors[0] / way, digits=2)
        why = f"the peak is {part} of the way"
        if settles:
            why += "; the late error is smaller than the peak, but see the section on late errors"
        return Judgement(ours, verdict(holds), why)

    return judge


@judge_by("case1")
def held(results: Results, ledger: Ledger) -> Judgement:
    """Judge what Case 1 is to leave where it is."""
    result, n = results["case1"], ledger.of("case1")
    sideways = peak(result.position_error.isel(axis=slice(0, 2)))
    turned, joint = peak(result.attitude_error), peak(result.joint_error)
    ours = (
        f"x, y {n('peak sideways error', sideways, 'm')}; attitude "
        f"{n('peak attitude error', turned, 'rad')}; joints "
        f"{n('peak joint error', joint, 'rad')}"
    )
    way = np.abs(results.mission("case1").position).max()
    holds = sideways < SMALL * way and max(turned, joint) < SMALL
    return Judgement(ours, verdict(holds), "all stay within a thousandth")


def chattering(run: str) -> Judge:
    """Judge whether the observer takes ripple from the control force."""

    @judge_by(*(f"{run}{s}" for s in ("", "-no-observer", "-switching", "-switching-no-observer")))
    def judge(results: Results, ledger: Ledger) -> Judgement:
        texts, ratios = [], []
        for kind, what in (("", "as printed"), ("-switching", "without boundary layer")):
            names = (f"{run}{kind}", f"{run}{kind}-no-observer")
            force = [ripple(results[name].generalized_force[:, :3]) for name in names]
            shown = [ledger.of(name)("force ripple", v, "N") for name, v in zip(names, force, strict=True)]
            ratios.append(force[0] / force[1])
            texts.append(f"{what}: {shown[0]} with, {shown[1]} without observer")
        note = ledger.of(run, f"{run}-no-observer")
        ratio = note("force ripple, with over without observer", ratios[0], digits=2)
        bare = ledger(
            f"{run}: force ripple without boundary layer, with over without observer",
            ratios[1],
            runs=[f"{run}-switching", f"{run}-switching-no-observer"],
            digits=2,
        )
        why = (
            f"the observer changes the ripple by a factor of {ratio}: inside the boundary layer "
            "of Eq. 62 the law is continuous, with or without observer. Without the layer (Eq. 54) "
            f"both switch, and the factor is {bare}"
        )
        return Judgement("; ".join(texts), verdict(ratios[0] < 1 / NOTABLE), why)

    return judge


def smooth(run: str) -> Judge:
    """Judge whether the control force is continuous."""

    @judge_by(run, f"{run}-no-observer")
    def judge(results: Results, ledger: Ledger) -> Judgement:
        parts, shown = [], []
        for name in (run, f"{run}-no-observer"):
            force = results[name].generalized_force[:, :3]
            parts.append(largest_jump(force) / peak(force))
            shown.append(ledger.of(name)("largest jump of force per peak", parts[-1], digits=2))
        with_observer, without = shown
        why = f"equally so without observer ({without}); the boundary layer does it"
        ours = f"largest change in one logged step: {with_observer} of the peak"
        return Judgement(ours, verdict(parts[0] < SMOOTH), why)

    return judge


@judge_by("case1")
def most_by_robot_4(results: Results, ledger: Ledger) -> Judgement:
    """Judge the share of Robot 4."""
    shares = force_shares(results["case1"])
    ours = _shares(results, ledger)
    holds = int(shares.argmax()) == 3 and shares[3] > MOST
    return Judgement(ours, verdict(holds), "Robot 4 carries more than the others together")


@judge_by("case1")
def nothing_by_robot_3(results: Results, ledger: Ledger) -> Judgement:
    """Judge the share of Robot 3."""
    share = force_shares(results["case1"])[2]
    force = float(norm(results["case1"].base_force.sel(robot=3)).max())
    ours = ledger.of("case1")("peak base force, Robot 3", force, "N")
    why = "the layout was not fitted to this; see *What the source leaves out*"
    return Judgement(ours, verdict(share < NEARLY_NOTHING), why)


@judge_by("case1")
def balance(results: Results, ledger: Ledger) -> Judgement:
    """Judge the share of the other three robots."""
    shares = force_shares(results["case1"])
    together = float(shares[[0, 1, 3]].sum())
    ours = "together " + ledger.of("case1")("share of Robots 1, 2, 4", together, "%")
    return Judgement(ours, verdict(together > 1 - NEARLY_NOTHING), "the rest is Robot 3's")


@judge_by("case1")
def near_the_centroid(results: Results, ledger: Ledger) -> Judgement:
    """Judge where Robot 3 is."""
    modes = results.run("case1").space_truss(results.folder).dynamics.modes
    centroid = modes.static_moment / modes.mass
    distances = np.linalg.norm((modes.grasp_positions - centroid)[:, :2], axis=1)
    shown = [
        ledger(f"truss: distance of grasp {i} from the centroid in the plane", float(d), "m")
        for i, d in enumerate(distances, 1)
    ]
    ours = f"in the plane {shown[2]} away; the others {shown[0]}, {shown[1]}, {shown[3]}"
    why = (
        "nearest of the four, but not near; that Robot 3 idles follows from the lever arms of all "
        "four. For the reconstructed truss: the source does not say where the centroid is"
    )
    return Judgement(ours, verdict(int(distances.argmin()) == 2), why)


@judge_by("case1", "case1-equal-weights")
def distribution(results: Results, ledger: Ledger) -> Judgement:
    """Judge what the weights save."""
    impulse, torque, shown = {}, {}, {}
    for name in ("case1", "case1-equal-weights"):
        result, n = results[name], ledger.of(name)
        step = float(np.diff(result["time"].values[:2])[0])
        impulse[name] = float(np.linalg.norm(result.base_force.values, axis=2).sum() * step)
        torque[name] = peak(result.base_torque)
        shown[name] = (
            n("impulse of the base forces", impulse[name], "N*s"),
            n("peak base torque", torque[name], "N*m"),
        )
    (force, turn), (even_force, even_turn) = shown.values()
    ours = f"impulse {force}, torque {turn}; with W = I {even_force}, {even_turn}"
    saves = any(of["case1"] < of["case1-equal-weights"] / NOTABLE for of in (impulse, torque))
    why = (
        "the source compares W with nothing; beside equal weights it saves neither thrust nor "
        f"torque by a factor of {NOTABLE:g}"
    )
    return Judgement(ours, verdict(saves), why)


@judge_by("case1")
def uniform(results: Results, ledger: Ledger) -> Judgement:
    """Judge whether the load is spread evenly."""
    shares = force_shares(results["case1"])
    uniform = shares.max() < NOTABLE / len(shares)
    why = "contradicts the source's own Figure 6, where Robot 4 carries most and Robot 3 nothing"
    return Judgement(_shares(results, ledger), verdict(uniform), why)


def _shares(results: Results, ledger: Ledger) -> str:
    shares = force_shares(results["case1"])
    n = ledger.of("case1")
    shown = [n(f"share of Robot {i}", float(s), "%", digits=2) for i, s in enumerate(shares, 1)]
    return "shares of Robots 1 to 4: " + ", ".join(shown)


def torque(run: str) -> Judge:
    """Judge the bound on the control torques; it may rest on where the arms are mounted on their bases."""
    mountings = [f"{run}{suffix}" for suffix in ("-centroid-at-joint", "-mounting")]

    @judge_by(run, *mountings)
    def judge(results: Results, ledger: Ledger) -> Judgement:
        bound, n = TORQUE_BOUNDS[results.run(run).case], ledger.of(run)
        torques = _claimed_torques(results, run)
        peaks = {name: peak(t) for name, t in torques.items()}
        worst = max(peaks.values())
        ours = ", ".join(f"{k} {n(f'claimed {k} torque', v, 'N*m')}" for k, v in peaks.items())
        largest = torques["base" if peaks["base"] >= peaks["joint"] else "joint"]
        sizes = np.abs(largest.values).reshape(len(largest), -1).max(axis=1)
        at = float(results[run]["time"].values[sizes.argmax()])
        excess = n("excess over the claimed torque", worst / bound - 1, "%", digits=2)
        why = (
            f"exceeded by {excess}, at {n('time of the largest torque', at, 's')}; the rigid part "
            "depends on the mounting of the base, which the source does not give"
        )
        others = [max(map(peak, _claimed_torques(results, other).values())) for other in mountings]
        if min(others) <= bound < max(*others, worst):
            return Judgement(ours, OPEN, f"{why}: with other mountings it is met or exceeded")
        return Judgement(ours, verdict(worst <= bound), why if worst > bound else "holds")

    return judge


def _claimed_torques(results: Results, run: str) -> dict[str, xr.DataArray]:
    """Return the torques that the claim of a case is about."""
    result = results[run]
    if results.run(run).case == 1:  # Figure 7 is about Robot 4
        result = of_robot(result, 4)
    return {"base": result.base_torque, "joint": result.joint_torque}


def flexible(run: str) -> Judge:
    """Judge the elastic displacement at Robot 4."""

    @judge_by(run)
    def judge(results: Results, ledger: Ledger) -> Judgement:
        result, n = results[run], ledger.of(run)
        last = peak(result.grasp_displacement.sel(robot=4))
        way = np.abs(results.mission(run).position).max()
        ours = n("peak elastic displacement at Robot 4", last, "m")
        return Judgement(ours, verdict(last < SMALL * way), "below a thousandth of the way")

    return judge


@judge_by("case1")
def most_affected(results: Results, ledger: Ledger) -> Judgement:
    """Judge where the elastic displacement is largest."""
    moved = [peak(results["case1"].grasp_displacement.sel(robot=i)) for i in (1, 2, 3, 4)]
    n = ledger.of("case1")
    shown = [n(f"peak elastic displacement at grasp {i}", m, "m") for i, m in enumerate(moved, 1)]
    why = "largest at the grasp point of Robot 4"
    return Judgement(", ".join(shown), verdict(int(np.argmax(moved)) == 3), why)


@judge_by("case1")
def joint(results: Results, ledger: Ledger) -> Judgement:
    """Judge the motion of the first joint of Robot 4."""
    result, n = results["case1"].sel(joint="theta_4_1"), ledger.of("case1")
    angle, rate = peak(result.joint_error), peak(result.joint_rate)
    ours = f"{n('peak angle of C41', angle, 'rad')}, {n('peak rate of C41', rate, 'rad/s')}"
    return Judgement(ours, verdict(angle < SMALL), "")


def better(case: int, rival: str, label: str, *, late_only: bool = False) -> Judge:
    """Judge the errors of a `case` against those of a `rival` law, with the source's step.

    The text calls the rival `label`; with `late_only`, only late errors are compared.
    """
    ours, theirs = f"case{case}", f"case{case}-{rival}"
    fine = (f"{ours}-fine", f"{theirs}-fine") if rival == "smc" else ()

    @judge_by(ours, theirs, *fine)
    def judge(results: Results, ledger: Ledger) -> Judgement:
        texts = []
        for when, what, unit in _kinds(late_only):
            name = f"{when} {what.replace('_', ' ')}"
            shown = [ledger.of(r)(name, error_size(results[r], what, when), unit) for r in (ours, theirs)]
            texts.append(f"{name} {shown[0]} against {shown[1]}")
        factor, text = _advantage(results, ledger, ours, theirs, late_only)
        why = f"{label}'s are larger by a factor of at least {text}"
        word = verdict(factor > NOTABLE)
        if fine:
            resolved, least = _advantage(results, ledger, *fine, late_only)
            why += (
                f". With a tenth of the source's step for both, the least factor is {least}: the "
                "switching law's error is that of the step, not of the law"
            )
            if word == REPRODUCED and resolved < 1.0:
                word = COARSE
        return Judgement("; ".join(texts), word, why)

    return judge


def _kinds(late_only: bool) -> list[tuple[str, str, str]]:
    whens = ("late",) if late_only else ("peak", "late")
    whats = (("position_error", "m"), ("attitude_error", "rad"))
    return [(when, what, unit) for when in whens for what, unit in whats]


def _advantage(
    results: Results, ledger: Ledger, ours: str, theirs: str, late_only: bool
) -> tuple[float, str]:
    """Return the least ratio of their errors to ours, as a number and as text."""
    least = min(
        error_size(results[theirs], what, when) / error_size(results[ours], what, when)
        for when, what, _ in _kinds(late_only)
    )
    name = f"least advantage of the proposed law{', late' if late_only else ''}"
    return least, ledger.of(theirs, ours)(name, least, digits=2)


def smoother(case: int) -> Judge:
    """Judge the ripple of the velocity against that of SMC as its formula reads."""
    ours, *rivals = (f"case{case}{s}" for s in ("", "-smc", "-smc-fine", "-smc-observer"))

    @judge_by(ours, *rivals)
    def judge(results: Results, ledger: Ledger) -> Judgement:
        found = {run: ripple(results[run].position_error_rate) for run in (ours, *rivals)}
        shown = [ledger.of(run)("velocity ripple", value, "m/s") for run, value in found.items()]
        name = "velocity ripple over that of the proposed law"
        factors = [ledger.of(r, ours)(name, found[r] / found[ours], digits=2) for r in rivals]
        why = (
            f"SMC's is larger by a factor of {factors[0]}. It switches within the source's steps; "
            f"with a tenth of the step the factor is {factors[1]}, and with the observer added to "
            f"SMC it is {factors[2]}"
        )
        text = f"velocity ripple {shown[0]}, SMC {shown[1]}"
        return Judgement(text, verdict(found[rivals[0]] > NOTABLE * found[ours]), why)

    return judge
