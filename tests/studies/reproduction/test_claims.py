"""Verdicts on invented numbers: each criterion can hold and can fail."""

import pytest
from reproduction.claims import COARSE, CRITERIA, DIFFERS, OPEN, REPRODUCED, verdict
from reproduction.report_numbers import Numbers
from study_tools.ledger import Ledger

HOLD, FAIL = REPRODUCED, DIFFERS


def judged(criterion, values, case=1):
    """Return the verdict on numbers that are keyed by their full names."""
    measures = {}
    for name, value in values.items():
        subject, _, measure = name.partition(": ")
        measures.setdefault(subject, {})[measure] = value
    return verdict(criterion, Numbers(measures, Ledger(), case))


def tracking(peak=1e-6, late=1e-7, joint=0.0, turn=0.0):
    errors = {
        f"case1: {when} {kind} error": value
        for when, value in (("peak", peak), ("late", late))
        for kind in ("position", "attitude")
    }
    motion = {"case1: commanded displacement": 6.0, "case1: commanded angle": turn}
    return (
        errors
        | motion
        | {"case1: peak sideways error": peak, "case1: peak joint error": joint}
    )


def shares(*values):
    return {f"case1: share of Robot {i}": value for i, value in enumerate(values, 1)}


def ripple(own, other, suffix):
    return {f"case1: {kind} ripple": own for kind in ("force", "velocity", "modal")} | {
        f"case1{suffix}: {kind} ripple": other
        for kind in ("force", "velocity", "modal")
    }


def torques(bound, usual, at_joint, mounting):
    suffixes = {"": usual, "-centroid-at-joint": at_joint, "-mounting": mounting}
    return {"case1: torque bound": bound} | {
        f"case1{k}: claimed torque": v for k, v in suffixes.items()
    }


def advantage(name, usual, fine=3.0, rival="-smc"):
    return {
        f"case1{rival} over case1: {name}": usual,
        f"case1{rival}-fine over case1-fine: {name}": fine,
    }


def weights(impulse, torque):
    values = {"impulse of the base forces": impulse, "peak base torque": torque}
    usual = {f"case1: {name}": 1.0 for name in values}
    return usual | {
        f"case1-equal-weights: {name}": value for name, value in values.items()
    }


def bandwidths(*values):
    names = "case1-L-1", "case1-L-2", "case1", "case1-L-8", "case1-L-16"
    return {
        f"{name}-fine: settled estimation error": value
        for name, value in zip(names, values, strict=True)
    }


def plant(rank=6, exact=10):
    return {
        "plant: rank of the arms": rank,
        "plant: operations": 10,
        "plant: operations with exact integrals": exact,
    }


def robots(subject, *values):
    return {f"{subject} {i}": value for i, value in enumerate(values, 1)}


BENT = "case1: peak elastic displacement at grasp"
DISTANCE = "truss: distance of grasp"
CASES = [
    ("small errors", HOLD, tracking()),
    ("small errors", FAIL, tracking(peak=0.1)),
    ("small errors", FAIL, tracking(peak=2e-3, turn=1.0)),
    ("errors small and settled", HOLD, tracking()),
    ("errors small and settled", FAIL, tracking(late=2e-6)),
    ("other coordinates held", HOLD, tracking()),
    ("other coordinates held", FAIL, tracking(joint=0.1)),
    ("less chattering", HOLD, ripple(0.4, 1.0, "-no-observer")),
    ("less chattering", FAIL, ripple(0.9, 1.0, "-no-observer")),
    ("smooth force", HOLD, {"case1: largest jump of force per peak": 0.01}),
    ("smooth force", FAIL, {"case1: largest jump of force per peak": 0.5}),
    ("nothing to compare with", OPEN, {}),
    ("estimation error falls with L", HOLD, bandwidths(5.0, 4.0, 3.0, 2.0, 1.0)),
    ("estimation error falls with L", FAIL, bandwidths(5.0, 4.0, 3.0, 2.0, 2.5)),
    ("less vibration", HOLD, ripple(0.4, 1.0, "-no-observer")),
    ("less vibration", FAIL, ripple(0.9, 1.0, "-no-observer")),
    ("cheaper integrals", HOLD, plant(exact=11)),
    ("cheaper integrals", FAIL, plant(exact=10)),
    ("arms of full rank", HOLD, plant()),
    ("arms of full rank", FAIL, plant(rank=3)),
    ("uniform load", HOLD, shares(0.27, 0.27, 0.19, 0.27)),
    ("uniform load", FAIL, shares(0.1, 0.1, 0.0, 0.8)),
    ("most by Robot 4", HOLD, shares(0.2, 0.2, 0.0, 0.6)),
    ("most by Robot 4", FAIL, shares(0.2, 0.6, 0.0, 0.2)),
    ("nearly nothing by Robot 3", HOLD, shares(0.2, 0.2, 0.01, 0.6)),
    ("nearly nothing by Robot 3", FAIL, shares(0.2, 0.2, 0.2, 0.4)),
    ("balance of the others", HOLD, {"case1: share of Robots 1, 2, 4": 0.99}),
    ("balance of the others", FAIL, {"case1: share of Robots 1, 2, 4": 0.9}),
    ("Robot 3 nearest the centroid", HOLD, robots(DISTANCE, 7.0, 3.0, 2.0, 3.0)),
    ("Robot 3 nearest the centroid", FAIL, robots(DISTANCE, 7.0, 1.0, 2.0, 3.0)),
    ("weights save input", HOLD, weights(1.0, 3.0)),
    ("weights save input", FAIL, weights(1.0, 1.5)),
    ("bounded torques", HOLD, torques(0.25, 0.25, 0.2, 0.25)),
    ("bounded torques", FAIL, torques(0.25, 0.26, 0.26, 0.4)),
    ("bounded torques", OPEN, torques(0.25, 0.26, 0.2, 0.4)),
    ("bounded torques", OPEN, torques(0.25, 0.25, 0.2, 0.4)),
    ("Robot 4 bends most", HOLD, robots(BENT, 0.0, 1e-5, 2e-5, 1e-4)),
    ("Robot 4 bends most", FAIL, robots(BENT, 0.0, 1e-5, 2e-4, 1e-4)),
    (
        "small elastic displacement",
        HOLD,
        tracking() | robots(BENT, 0.0, 0.0, 0.0, 1e-3),
    ),
    (
        "small elastic displacement",
        FAIL,
        tracking() | robots(BENT, 0.0, 0.0, 0.0, 1e-2),
    ),
    ("joint at rest", HOLD, {"case1: peak angle of C41": 1e-6}),
    ("joint at rest", FAIL, {"case1: peak angle of C41": 0.1}),
    ("smaller errors than PD", HOLD, advantage("advantage", 10.0, rival="-pd")),
    ("smaller errors than PD", FAIL, advantage("advantage", 1.5, rival="-pd")),
    ("smaller errors than SMC", HOLD, advantage("advantage", 3.0)),
    ("smaller errors than SMC", COARSE, advantage("advantage", 3.0, fine=0.5)),
    (
        "smaller late errors than SMC",
        COARSE,
        advantage("late advantage", 3.0, fine=0.5),
    ),
    ("smaller late errors than SMC", FAIL, advantage("late advantage", 0.5)),
    ("smaller velocity ripple than SMC", HOLD, ripple(1.0, 3.0, "-smc")),
    ("smaller velocity ripple than SMC", FAIL, ripple(1.0, 1.0, "-smc")),
]


@pytest.mark.parametrize("criterion, expected, values", CASES)
def test_verdict(criterion, expected, values):
    assert judged(criterion, values) == expected


def test_each_criterion_is_tested():
    assert {criterion for criterion, *_ in CASES} == set(CRITERIA)
