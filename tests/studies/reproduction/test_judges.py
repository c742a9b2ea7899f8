"""Verdicts on made-up results: each claim can come out, and can fail."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from reproduction import MissionRun, Results, judges
from reproduction.claims import COARSE, DIFFERS, OPEN, REPRODUCED, Claim
from reproduction.runs import all_missions
from reproduction.statements import STATEMENTS
from study_tools.ledger import Ledger

TIME = np.arange(0.0, 80.0 + 1e-9, 0.05)
FAST = (-1.0) ** np.arange(len(TIME))


def made_up(*, error=1e-6, late=1e-7, ripple=1e-3, jump=0.0, torque=0.1, forces=(2.0, 2.0, 0.0, 8.0)):
    """Return a mission with errors, forces and ripple of chosen size."""
    vector, robots = np.zeros((len(TIME), 3)), np.zeros((len(TIME), 4, 3))
    errors = vector.copy()
    errors[:, 0] = np.where(TIME < 60.0, error, late)
    force = vector.copy()
    force[:, 2] = np.sin(TIME / 20) + ripple * FAST + jump * (TIME > 30)
    shares = robots.copy()
    shares[:, :, 2] = forces
    joints = np.zeros((len(TIME), 28))
    names = [f"theta_{i}_{j}" for i in range(1, 5) for j in range(1, 8)]
    moved = robots.copy()
    moved[:, :, 0] = [0.0, 1e-5, 2e-5, 1e-4]
    velocity = vector.copy()
    velocity[:, 0] = ripple * FAST
    return xr.Dataset(
        {
            "position_error": (("time", "axis"), errors),
            "attitude_error": (("time", "angle"), errors),
            "position_error_rate": (("time", "axis"), velocity),
            "joint_error": (("time", "joint"), joints),
            "joint_rate": (("time", "joint"), joints),
            "joint_torque": (("time", "joint"), joints),
            "base_torque": (("time", "robot", "axis"), robots + torque),
            "base_force": (("time", "robot", "axis"), shares),
            "grasp_displacement": (("time", "robot", "axis"), moved),
            "generalized_force": (("time", "coordinate"), force),
        },
        coords={"time": TIME, "robot": [1, 2, 3, 4], "joint": names},
    )


class Made(Results):
    """Results that were made up."""

    def __init__(self, data, duration):
        runs = [MissionRun(name=name, case=int(name[4]), duration=duration) for name in data]
        super().__init__(runs, [], Path("unused"))
        self.data = data

    def __getitem__(self, name):
        return self.data[name]


def judged(judge, duration=80.0, **runs):
    """Return the verdict on made-up runs, named with _ in place of -."""
    data = {name.replace("_", "-"): made_up(**options) for name, options in runs.items()}
    assert set(data) == set(judge.runs)  # what it says it looks at is what it does look at
    return Claim("", "", "", judge).judged(Made(data, duration), Ledger()).verdict


def test_tracking():
    assert judged(judges.tracking("case1", settles=True), case1={}) == REPRODUCED
    assert judged(judges.tracking("case1", settles=True), case1={"error": 0.1}) == DIFFERS
    assert judged(judges.tracking("case1", settles=True), case1={"late": 2e-6}) == DIFFERS
    assert judged(judges.tracking("case2", settles=False), case2={"late": 2e-6}) == REPRODUCED


def test_a_part_of_a_mission_cannot_be_judged():
    assert judged(judges.tracking("case1", settles=True), duration=60.0, case1={}) == OPEN


@pytest.mark.parametrize(("ripple", "verdict"), [(4e-4, REPRODUCED), (9e-4, DIFFERS)])
def test_chattering(ripple, verdict):
    found = judged(
        judges.chattering("case1"),
        case1={"ripple": ripple},
        case1_no_observer={"ripple": 1e-3},
        case1_switching={},
        case1_switching_no_observer={},
    )
    assert found == verdict


def test_smoothness():
    judge = judges.smooth("case1")
    assert judged(judge, case1={}, case1_no_observer={}) == REPRODUCED
    assert judged(judge, case1={"jump": 0.5}, case1_no_observer={}) == DIFFERS


@pytest.mark.parametrize(
    ("judge", "good", "bad"),
    [
        (judges.most_by_robot_4, (2, 2, 0, 8), (2, 8, 0, 2)),
        (judges.nothing_by_robot_3, (2, 2, 0.1, 8), (2, 2, 2, 8)),
        (judges.balance, (2, 2, 0.1, 8), (2, 2, 2, 8)),
        (judges.uniform, (3, 3, 2, 3), (2, 2, 0, 8)),
    ],
)
def test_shares(judge, good, bad):
    assert judged(judge, case1={"forces": good}) == REPRODUCED
    assert judged(judge, case1={"forces": bad}) == DIFFERS


@pytest.mark.parametrize(("run", "bound"), [("case1", 0.25), ("case2", 0.8)])
def test_torque(run, bound):
    for torque, least, most, verdict in (
        (bound, 0.9, 1.0, REPRODUCED),
        (1.01 * bound, 1.01, 1.5, DIFFERS),
        (1.01 * bound, 0.9, 1.5, OPEN),
        (bound, 0.9, 1.5, OPEN),
    ):
        torques = {run: torque, f"{run}_centroid_at_joint": least * bound, f"{run}_mounting": most * bound}
        runs = {name: {"torque": value} for name, value in torques.items()}
        assert judged(judges.torque(run), **runs) == verdict


def test_weights_save_something():
    assert judged(judges.distribution, case1={}, case1_equal_weights={}) == DIFFERS
    assert judged(judges.distribution, case1={}, case1_equal_weights={"torque": 0.3}) == REPRODUCED


def test_other_laws():
    worse = {"error": 1e-5, "late": 1e-6}
    judge = judges.better(1, "pd", "PD")
    assert judged(judge, case1={}, case1_pd=worse) == REPRODUCED
    assert judged(judge, case1={}, case1_pd={**worse, "late": 1.5e-7}) == DIFFERS
    judge = judges.better(1, "smc", "SMC", late_only=True)
    fine: Any = {"case1_fine": {}, "case1_smc_fine": {}}
    assert judged(judge, case1={}, case1_smc={"late": 3e-7}, **fine) == REPRODUCED
    assert judged(judge, case1={}, case1_smc={"late": 5e-8}, **fine) == DIFFERS
    fine["case1_smc_fine"] = {"late": 5e-8}
    assert judged(judge, case1={}, case1_smc={"late": 3e-7}, **fine) == COARSE


def test_smoother_than_smc():
    rough = {"ripple": 3e-3}
    others: Any = {"case1_smc_fine": {}, "case1_smc_observer": {}}
    judge = judges.smoother(1)
    assert judged(judge, case1={}, case1_smc=rough, **others) == REPRODUCED
    assert judged(judge, case1=rough, case1_smc=rough, **others) == DIFFERS


def test_small_motions():
    for judge in (judges.held, judges.joint, judges.most_affected, judges.flexible("case1")):
        assert judged(judge, case1={}) == REPRODUCED
    assert judged(judges.held, case1={"error": 0.1}) == DIFFERS


def test_statements_are_quoted_once_and_name_runs_of_the_report():
    quotes = [claim.quote for claim in STATEMENTS]
    assert len(set(quotes)) == len(quotes)
    known = all_missions(80.0)
    assert all(run in known for claim in STATEMENTS for run in claim.judge.runs)
