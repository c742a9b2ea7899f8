"""A state machine: one transition at a sample, the first that is listed."""

import random

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from trussflow.blocks import StateMachine, TimeTable

MISSION = {
    "idle": {"go": "coast"},
    "coast": {"abort": "safe", "near": "brake"},
    "brake": {"abort": "safe"},
    "safe": {"go": "idle"},
}


@pytest.mark.parametrize("seed", range(5))
def test_random_conditions(seed, respond):
    random_, times = random.Random(seed), np.arange(40) * 0.1
    conditions = {
        n: [float(random_.random() < 0.4) for _ in times]
        for n in ("go", "abort", "near")
    }
    machine = StateMachine(MISSION, 0.1)
    sources = {n: TimeTable(times, v) for n, v in conditions.items()}
    result = respond(machine, 3.9, {"step": 0.1}, **sources)
    present, expected = "idle", []
    for k in range(40):
        leads = MISSION[present].items()
        present = next(
            (target for name, target in leads if conditions[name][k] > 0.5), present
        )
        expected.append(machine.modes.index(present))
    assert_array_equal(result["block.mode"], expected)
    assert_array_equal(result["block.active"], np.eye(4)[expected])
