"""Write the accelerations that Exudyn computes for the truss and its robots.

``python tests/models/dynamics/exudyn/generate.py`` writes ``accelerations.npz`` beside itself.
It needs Exudyn 1.13 (``pip install -e .[exudyn]``) and none of this package; only the two
shipped files of arm parameters are read. The tests need the written file only.
"""

from __future__ import annotations

from pathlib import Path

import exudyn as exu
import numpy as np
from exudyn_system import State, TrussSystem
from pin_jointed_truss import truss
from scipy.linalg import null_space

FOLDER = Path(__file__).parent
ARMS = ["literal", "jaco", "literal", "jaco"]
SCALES = (1.0, 0.16, 0.08, 0.04, 0.02)

# Exudyn differentiates the joints' Jacobians numerically for their acceleration. With this
# step its noise is least.
DIFFERENCE_STEP = 1e-6


def settings():
    chosen = exu.SimulationSettings()
    newton = chosen.timeIntegration.newton
    newton.numericalDifferentiation.relativeEpsilon = DIFFERENCE_STEP
    chosen.solution.file.write = False
    return chosen


def random_state(flexible, arms, deformation, rng):
    """Return a state whose elastic displacement is some decimetres for `deformation` 1."""
    stiffness = (flexible.frequencies / flexible.frequencies[0]) ** 2
    modal = 5.0 * deformation * rng.standard_normal(len(stiffness)) / stiffness
    rates = rng.standard_normal(len(stiffness)) / np.sqrt(stiffness)
    speeds = 0.3 * rng.standard_normal(6 + 7 * arms)
    places = [
        rng.standard_normal(3),
        rng.uniform(-1, 1, 3),
        rng.uniform(-2, 2, 7 * arms),
    ]
    return State(
        q=np.concatenate([*places, modal]),
        v=np.concatenate([speeds, rates]),
        actuation=rng.standard_normal(13 * arms),
    )


def deformed(state, modal, scale=1.0):
    """Return the state with other modal coordinates, speeds and inputs multiplied."""
    q = state.q.copy()
    q[state.modes] = modal
    return State(q=q, v=scale * state.v, actuation=scale * state.actuation)


def case(flexible, arms, state):
    """Return a state and its accelerations."""
    system = TrussSystem(flexible, arms, state)
    solver = exu.MainSolverImplicitSecondOrder()
    if not solver.InitializeSolver(system.mbs, settings()):
        raise RuntimeError("Exudyn found no initial accelerations")
    return {
        "arms": np.array(arms, dtype=str),
        "q": state.q,
        "v": state.v,
        "actuation": state.actuation,
        "accelerations": system.accelerations(),
    }


def accelerations(any_axis, one_axis):
    rng = np.random.default_rng(2026)
    found = {}

    def add(name, content):
        found.update({f"{name}.{key}": value for key, value in content.items()})

    add("any_axis", any_axis.fields())
    add("one_axis", one_axis.fields())
    turning = np.concatenate([any_axis.grasp(i)[2] for i in range(4)])
    not_turned = null_space(turning)
    for i in range(2):
        add(f"alone.{i}", case(any_axis, [], random_state(any_axis, 0, 1.0, rng)))
        for count in (1, 4):
            state = random_state(any_axis, count, 0.0, rng)
            add(f"undeformed_{count}.{i}", case(any_axis, ARMS[:count], state))
        state = random_state(any_axis, 4, 1.0, rng)
        modal = 10.0 * not_turned @ rng.standard_normal(not_turned.shape[1])
        add(f"hands_not_turned.{i}", case(any_axis, ARMS, deformed(state, modal)))
    state = random_state(one_axis, 4, 1.0, rng)
    for i, scale in enumerate(SCALES):
        smaller = deformed(state, scale * state.q[state.modes], scale)
        add(f"deformed_one_axis.{i}", case(one_axis, ARMS, smaller))
    return found


if __name__ == "__main__":
    whole = truss()
    axes = np.random.default_rng(5).standard_normal((4, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    np.savez_compressed(
        FOLDER / "accelerations.npz",
        **accelerations(whole.reduced(16), whole.reduced(6, axes)),
    )
