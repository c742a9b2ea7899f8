"""A state machine: one transition at a sample, the first that is listed."""

import random

import numpy as np
import pytest

from trussflow.blocks import BlockError, StateMachine, TimeTable, TrussflowError

MISSION = {
    "idle": {"go": "coast"},
    "coast": {"abort": "safe", "near": "brake"},
    "brake": {},
    "safe": {"go": "idle"},
}


@pytest.mark.parametrize("seed", range(5))
def test_random_conditions(seed, respond):
    random_, times = random.Random(seed), np.arange(40) * 0.1
    conditions = {n: [float(random_.random() < 0.4) for _ in times] for n in ("go", "abort", "near")}
    machine = StateMachine({**MISSION, "brake": {"abort": "safe"}}, 0.1)
    sources = {n: TimeTable(times, v) for n, v in conditions.items()}
    result = respond(machine, 3.9, {"step": 0.1}, **sources)
    present, expected = "idle", []
    for k in range(40):
        leads = {**MISSION, "brake": {"abort": "safe"}}[present]
        present = next((target for name, target in leads.items() if conditions[name][k] > 0.5), present)
        expected.append(machine.modes.index(present))
    np.testing.assert_array_equal(result["block.mode"], expected)
    np.testing.assert_array_equal(result["block.active"], np.eye(4)[expected])


@pytest.mark.parametrize(
    ("transitions", "message"),
    [
        ({"a": {"go": "b"}}, "StateMachine has no mode 'b'; its modes are: a"),
        ({}, "StateMachine has no modes"),
        (["a"], "modes must be given by name"),
        ({"a": {"mode": "a"}}, "StateMachine cannot have a condition 'mode'"),
    ],
)
def test_nonsense_is_refused(transitions, message):
    with pytest.raises(TrussflowError, match=message):
        StateMachine(transitions, 0.1)


def test_sample_time():
    with pytest.raises(BlockError, match="cannot sample"):
        StateMachine(MISSION, 0.0)
