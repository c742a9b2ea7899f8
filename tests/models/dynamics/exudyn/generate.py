"""Write what Exudyn computes for the truss and its robots: accelerations and a motion.

``python tests/models/exudyn/generate.py`` writes ``accelerations.npz`` and ``motion.npz`` beside
itself, in some minutes. It needs Exudyn 1.13 (``pip install -e .[exudyn]``) and none of this
package; only the two shipped files of arm parameters are read. The tests need the two files only.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
from exudyn_system import OUTPUT, State, TrussSystem
from pin_jointed_truss import truss
from scipy.linalg import null_space

FOLDER = Path(__file__).parent
ARMS = ["literal", "jaco", "literal", "jaco"]
SCALES = (1.0, 0.16, 0.08, 0.04, 0.02)

# Exudyn differentiates the joints' Jacobians numerically for their acceleration. With the first
# step its noise is least; the second shows how large it is.
DIFFERENCE_STEPS = (1e-6, 3e-6)

INITIAL = exu.ConfigurationType.Initial

DURATION = 2.5  # [s]
SAMPLES = 5
STEPS = (1280, 2560, 5120, 10240)
NEWTON = 1e-10  # relative; much less is lost in round-off


def settings(difference_step):
    chosen = exu.SimulationSettings()
    newton = chosen.timeIntegration.newton
    newton.numericalDifferentiation.relativeEpsilon = difference_step
    chosen.solution.file.write = False
    return chosen


def random_state(flexible, arms, deformation, rng):
    """Return a state whose elastic displacement is some decimetres for `deformation` 1."""
    stiffness = (flexible.frequencies / flexible.frequencies[0]) ** 2
    modal = 5.0 * deformation * rng.standard_normal(len(stiffness)) / stiffness
    rates = rng.standard_normal(len(stiffness)) / np.sqrt(stiffness)
    speeds = 0.3 * rng.standard_normal(6 + 7 * arms)
    places = [rng.standard_normal(3), rng.uniform(-1, 1, 3), rng.uniform(-2, 2, 7 * arms)]
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


def initialized(flexible, arms, state, step):
    """Return the system with the accelerations of its initial state."""
    system = TrussSystem(flexible, arms, state)
    solver = exu.MainSolverImplicitSecondOrder()
    if not solver.InitializeSolver(system.mbs, settings(step)):
        raise RuntimeError("Exudyn found no initial accelerations")
    return system


def case(flexible, arms, state):
    return {
        "arms": np.array(arms, dtype=str),
        "q": state.q,
        "v": state.v,
        "actuation": state.actuation,
        "accelerations": np.array(
            [initialized(flexible, arms, state, s).accelerations() for s in DIFFERENCE_STEPS]
        ),
    }


def holding_marker(flexible, state):
    """Return how the marker that holds the first hand turns, by its rotation and by its rate.

    The rotations are those at modal coordinates tau + s h tau', s = -2..2, with the truss frame
    at rest; the rate is the angular velocity that the marker says it has at s = 0.
    """
    step = 1e-2
    modal, rates = state.q[state.modes], state.v[state.modes]
    rotations, velocities = [], []
    for s in (-2, -1, 0, 1, 2):
        q, v = state.q.copy(), np.zeros_like(state.v)
        q[:6], q[state.modes], v[state.modes] = 0.0, modal + s * step * rates, rates
        system = TrussSystem(flexible, ARMS, State(q=q, v=v, actuation=state.actuation))
        rotation, velocity = (
            np.array(system.mbs.GetMarkerOutput(system.holding[0], quantity, INITIAL))
            for quantity in (OUTPUT.RotationMatrix, OUTPUT.AngularVelocity)
        )
        rotations.append(rotation.reshape(3, 3))
        velocities.append(velocity)
    return {
        "modal": modal,
        "rates": rates,
        "step": np.array(step),
        "rotations": np.array(rotations),
        "angular_velocity": velocities[2],
    }


def accelerations(any_axis, one_axis):
    rng = np.random.default_rng(2026)
    found: dict[str, Any] = {}

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
    for name, flexible in (("one_axis", one_axis), ("any_axis", any_axis)):
        state = random_state(flexible, 4, 1.0, rng)
        for i, scale in enumerate(SCALES):
            smaller = deformed(state, scale * state.q[state.modes], scale)
            add(f"deformed_{name}.{i}", case(flexible, ARMS, smaller))
    add("marker", holding_marker(any_axis, state))
    return found


def motion(flexible):
    """Return a motion by the trapezoidal rule, at four steps, each half of the one before."""
    rng = np.random.default_rng(2027)
    state = random_state(flexible, 4, 0.5, rng)
    per_base = np.tile([0.1, 0.1, 0.1, 0.01, 0.01, 0.01], 4)
    inputs = np.concatenate([per_base, np.full(28, 1e-4)]) * state.actuation
    # Slow at the start: the links are light, and the moving truss shakes them soon enough.
    v = np.concatenate([0.03 * state.v[:34], state.v[34:]])
    state = State(q=state.q, v=v, actuation=inputs)
    runs = [trajectory(flexible, state, steps) for steps in STEPS]
    return {
        **{f"one_axis.{key}": value for key, value in flexible.fields().items()},
        "arms": np.array(ARMS),
        "q": state.q,
        "v": state.v,
        "actuation": state.actuation,
        "times": DURATION / SAMPLES * np.arange(1, SAMPLES + 1),
        "steps": DURATION / np.array(STEPS),
        **{name: np.array([run[name] for run in runs]) for name in runs[0]},
    }


def trajectory(flexible, state, steps):
    """Return place, attitude, joint angles, modal coordinates and speeds at the sample times."""
    system = TrussSystem(flexible, ARMS, state)
    every = DURATION / SAMPLES
    places, attitudes, joints, modes, speeds = [], [], [state.q[state.joints]], [], []

    def record(_, t):
        if abs(t / every - round(t / every)) < 1e-3 * DURATION / steps and t > 0.0:
            places.append(system.read(system.frame_node, OUTPUT.Position))
            attitudes.append(system.read(system.frame_node, OUTPUT.RotationMatrix).reshape(3, 3))
            joints.append(system.joint_angles())
            modes.append(system.read(system.modal_node, OUTPUT.Coordinates))
            speeds.append(system.speeds())
        return True

    chosen = settings(DIFFERENCE_STEPS[0])
    integration = chosen.timeIntegration
    integration.numberOfSteps, integration.endTime = steps, DURATION
    # The trapezoidal rule: its errors are a series in even powers of the step. Joints are imposed
    # on the positions; imposed on the speeds, Exudyn's hands slowly turn away from their markers.
    integration.generalizedAlpha.useNewmark = True
    integration.generalizedAlpha.useIndex2Constraints = False
    integration.newton.relativeTolerance = integration.newton.absoluteTolerance = NEWTON
    system.mbs.SetPostStepUserFunction(record)
    system.mbs.SolveDynamic(chosen)
    if len(places) != SAMPLES:
        raise RuntimeError(f"{len(places)} samples were taken instead of {SAMPLES}")
    return {
        "positions": np.array(places),
        "attitudes": np.array(attitudes),
        "joint_angles": np.unwrap(np.array(joints), axis=0)[1:],
        "modal": np.array(modes),
        "speeds": np.array(speeds),
    }


if __name__ == "__main__":
    whole = truss()
    axes = np.random.default_rng(5).standard_normal((4, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    turning_one_way = whole.reduced(6, axes)
    np.savez_compressed(FOLDER / "accelerations.npz", **accelerations(whole.reduced(16), turning_one_way))
    np.savez_compressed(FOLDER / "motion.npz", **motion(turning_one_way))
