"""The plant block: conservation and convergence in time, and the published energy identity."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Diagram, Function, Input, Integrator, Output, Simulator
from trussflow.blocks.framework.declarations import Signals
from trussflow.models import ModelError, RobotArm, SpaceTruss, TrussDynamics, TrussModes

STEPS = np.array([0.0025, 0.00125, 0.000625, 0.0003125])
"""The free system vibrates at up to some 100 rad/s; at these steps the order shows."""

DURATION = 1.0


def tumbling(truss):
    """Return deformed coordinates and tumbling speeds for the start."""
    rng = np.random.default_rng(3)
    q = truss.dynamics.rest + 0.3 * rng.standard_normal(truss.n)
    q[truss.rigid :] *= 0.2  # elastic displacements of centimetres
    return {"truss.q": q, "truss.v": 0.03 * rng.standard_normal(truss.n)}


def free(truss):
    """Return the plant without inputs."""
    diagram = Diagram("free truss")
    diagram.add(truss=truss)
    diagram.ground(truss.actuation)
    return diagram


def slope(errors):
    """Return the order at which errors fall with the step."""
    return float(np.polyfit(np.log(STEPS), np.log(errors), 1)[0])


@pytest.fixture(scope="module")
def runs():
    """Return, for each step and a reference, final q, v and the drift of what is conserved."""
    truss = SpaceTruss.consistent(damping=0.0)
    diagram, start = free(truss), tumbling(truss)
    found = []
    for step in [*STEPS, STEPS[-1] / 8]:
        log = ["truss.coordinates", "truss.speeds", "truss.energy"]
        result = Simulator(diagram, step=float(step), log=log, log_step=DURATION).run(
            DURATION, initial=start, progress=False
        )
        q, v = result["truss.coordinates"].values, result["truss.speeds"].values
        linear, angular = zip(*(truss.dynamics.momentum(q[i], v[i]) for i in (0, -1)), strict=True)
        energy = result["truss.energy"].values
        drift = {
            "energy": abs(energy[-1] / energy[0] - 1),
            "linear momentum": np.linalg.norm(linear[1] - linear[0]) / np.linalg.norm(linear[0]),
            "angular momentum": np.linalg.norm(angular[1] - angular[0]) / np.linalg.norm(angular[0]),
        }
        found.append((q[-1], v[-1], drift))
    return found


def test_trajectory_converges_at_fourth_order(runs):
    """RK4 against its own result at an eighth of the smallest step."""
    q, v, _ = runs[-1]
    errors = [float(np.linalg.norm(np.concatenate([a - q, b - v]))) for a, b, _ in runs[:-1]]
    assert slope(errors) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("kind", ["energy", "linear momentum", "angular momentum"])
def test_conserved_quantities_drift_at_fourth_order_or_better(runs, kind):
    """Free and undamped, with the truss deformed and tumbling: the drift falls to round-off."""
    drifts = [drift[kind] for _, _, drift in runs]
    round_off = 1e-13  # of 4000 steps on numbers of order 1
    above = [d for d in drifts[:-1] if d > 10 * round_off]
    if len(above) == len(STEPS):
        assert slope(above) > 3.9
    assert drifts[-1] < 1e-10
    assert all(a > 8 * b or b < 10 * round_off for a, b in itertools.pairwise(drifts))


def test_published_energy_identity_in_time():
    """dE/dt = - v·(ω × Pτ') - ω·(H_ω τ') for the published integrals and R_i = 0."""
    modes = TrussModes.reconstructed()
    modes = replace(modes, grasp_rotations=np.zeros_like(modes.grasp_rotations))
    arms = (RobotArm.literal(),) * modes.grasps
    truss = SpaceTruss(TrussDynamics(modes=modes, arms=arms, elastic_integrals=False), modal_actuation=False)
    spread, momentum = modes.second_moments, modes.momentum_coefficients
    rigid = truss.rigid

    def defect(speeds):
        velocity, omega, rates = speeds[:3], speeds[3:6], speeds[rigid:]
        mixed = sum(rates[a] * spread[0, a + 1] for a in range(modes.modes))  # ∫ r (Tτ')^T
        turning = omega * np.trace(mixed) - mixed.T @ omega  # ∫ r × (ω × Tτ')
        return -(velocity @ np.cross(omega, momentum @ rates) + omega @ turning)

    diagram = free(truss)
    power, work = diagram.add(
        power=Function(defect, {"speeds": Input(truss.n)}, {"y": Output(unit="W")}), work=Integrator()
    )
    truss.speeds >> power.speeds
    power.y >> work.u
    gaps = []
    for step in STEPS:
        log = [truss.energy, work.y]
        simulator = Simulator(diagram, step=float(step), log=log, log_step=DURATION)
        result = simulator.run(DURATION, initial=tumbling(truss), progress=False)
        energy, supplied = result["truss.energy"].values, result["work.y"].values
        assert abs(energy[-1] - energy[0]) > 0.1 * energy[0]  # the defect is there
        gaps.append(float(abs(energy[-1] - energy[0] - supplied[-1])))
    assert slope(gaps) > 3.9
    assert gaps[-1] < 1e-7 * energy[0]


def test_published_actuators_do_no_work_on_the_modes():
    """M (v'(Q) - v'(0)) is P Q; the modal rows of P are zero for `published` alone."""
    for truss, works in ((SpaceTruss.published(), False), (SpaceTruss.consistent(), True)):
        q, v = tumbling(truss).values()
        x, p = Signals("x", {"q": q, "v": v}), Signals("p", truss.parameters)
        actuation = np.random.default_rng(4).standard_normal(truss.actuators)
        accelerations = [
            truss.derivative(np.float64(0), x, Signals("u", {"actuation": values}), p)["v"]
            for values in (actuation, np.zeros(truss.actuators))
        ]
        terms = truss.dynamics.evaluate(q, v)
        expected = terms.actuation_matrix @ actuation
        assert np.abs(expected[truss.rigid :]).max() > 0.01
        if not works:
            expected[truss.rigid :] = 0.0
        force = terms.mass_matrix @ (accelerations[0] - accelerations[1])
        assert np.abs(force - expected).max() < 1e-8 * np.abs(expected).max()


def test_other_numbers_of_robots_and_modes():
    """Two robots and two modes make a plant like any other."""
    modes = TrussModes.reconstructed().truncated(2)
    modes = replace(
        modes,
        grasp_positions=modes.grasp_positions[:2],
        grasp_translations=modes.grasp_translations[:2],
        grasp_rotations=modes.grasp_rotations[:2],
    )
    truss = SpaceTruss(
        TrussDynamics(modes=modes, arms=(RobotArm.literal(), RobotArm.jaco()), elastic_integrals=True)
    )
    assert (truss.n, truss.robots, truss.actuators) == (22, 2, 26)
    result = Simulator(free(truss), step=1e-2, log=["truss.energy"], backend="interpreted").run(
        0.1, initial=tumbling(truss), progress=False
    )
    energy = result["truss.energy"].values
    assert abs(energy[-1] / energy[0] - 1) < 1e-6  # no damping in the published modal data


def test_rigid_truss():
    """Without modes the plant is a rigid multibody system and conserves energy."""
    truss = SpaceTruss.published(modes=0)
    result = Simulator(free(truss), step=1e-2, log=["truss.energy"]).run(
        1.0, initial=tumbling(truss), progress=False
    )
    energy = result["truss.energy"].values
    assert np.ptp(energy) < 1e-6 * energy[0]


def test_units_follow_the_coordinates():
    truss = SpaceTruss.published()
    assert truss.coordinates.element_units()[0] == "m"
    assert truss.coordinates.element_units()[3] == "rad"
    assert truss.coordinates.element_units()[-1] == "kg**0.5*m"
    assert truss.actuation.element_units()[:6] == ("N",) * 3 + ("N*m",) * 3


def test_unknown_arm():
    with pytest.raises(ModelError, match=r"no arm 'kuka'; choose from: literal, jaco"):
        SpaceTruss.published(arm="kuka")


def test_too_many_modes():
    with pytest.raises(ModelError, match=r"cannot keep 7 modes of 6"):
        SpaceTruss.published(modes=7)
