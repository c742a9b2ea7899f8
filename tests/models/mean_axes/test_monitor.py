"""The monitor of the actuators: whose loss it was, how soon, and no alarm from noise, bias or idleness.

The arms are those that it believes in, moved by the rigid equations at rest posture; what it sees is noisy.
"""

import numpy as np
import pytest

from trussflow.blocks import Diagram, Session
from trussflow.blocks.framework.types import Vector
from trussflow.models import ActuatorMonitor, Hardware, MeanAxesDesign, SpaceTruss
from trussflow.models.feasibility import ActuatorLimits, shares_left
from trussflow.models.transport import Mission, mean_axes_transport, path_of

TRUSS = SpaceTruss.consistent()
DYNAMICS = TRUSS.dynamics
RIGID = DYNAMICS.rigid_coordinates
REST = DYNAMICS.rest[:RIGID]
TERMS = DYNAMICS.evaluate(DYNAMICS.rest, np.zeros(DYNAMICS.coordinates))
RESPONSE = np.linalg.solve(TERMS.mass_matrix[:RIGID, :RIGID], TERMS.actuation_matrix[:RIGID])
GROUPS = [slice(6 * i, 6 * i + 6) for i in range(4)] + [slice(24 + 7 * i, 31 + 7 * i) for i in range(4)]
LOSSES = [(g,) for g in range(8)] + [(i, 4 + i) for i in range(4)]
"""Each base, each arm's drives, each whole robot."""
DESIGN = MeanAxesDesign.shipped()
SIZE = np.concatenate([np.tile([2.0] * 3 + [0.02] * 3, 4), [5e-3] * 28])
"""What is ordered: forces of newtons, torques as they hold an arm [N, N·m]."""


def watched(dead: tuple[int, ...], *, orders: float = 1.0, seed: int = 0, samples: int = 400) -> list[Vector]:
    """Return the effectiveness that the monitor shows at each sample; the loss is at half of them."""
    rng = np.random.default_rng(seed)
    diagram = Diagram("d")
    monitor = diagram.add(monitor=ActuatorMonitor(DYNAMICS, DESIGN))
    diagram.expose(position=monitor.position, velocity=monitor.velocity, actuation=monitor.actuation)
    diagram.ground(monitor.disturbance)
    diagram.expose(effectiveness=monitor.effectiveness)
    step, speeds, told = DESIGN.sample_time, np.zeros(RIGID), np.zeros(52)
    shown: list[Vector] = []
    with Session(diagram, step=step, backend="interpreted") as session:
        session.start(inputs={"position": REST, "velocity": speeds, "actuation": np.zeros(52)})
        for k in range(samples):
            # Twice there and twice back, so that speeds stay small.
            if k % 4 == 0:
                told = orders * SIZE * rng.standard_normal(52)
            elif k % 4 == 2:
                told = -told
            noise = DESIGN.rate_noise * rng.standard_normal(RIGID)
            session.set(velocity=speeds + noise, actuation=told)
            shown.append(session.outputs["effectiveness"])
            session.advance((k + 1) * step)
            acting = told.copy()
            for group in dead if k >= samples // 2 else ():
                acting[GROUPS[group]] = 0.0
            speeds = speeds + step * RESPONSE @ acting
    return shown


@pytest.mark.parametrize("dead", LOSSES)
def test_each_loss_is_named(dead: tuple[int, ...]) -> None:
    shown = watched(dead)
    lost = [[k for k, each in enumerate(shown) if each[group].max() == 0.0] for group in GROUPS]
    assert [bool(when) for when in lost] == [g in dead for g in range(8)]
    for group in dead:
        assert 200 < lost[group][0] < 200 + 0.5 / DESIGN.sample_time


@pytest.mark.parametrize("orders", [1.0, 0.01])
def test_no_alarm_of_healthy_actuators(orders: float) -> None:
    assert all((each == 1.0).all() for each in watched((), orders=orders))


@pytest.mark.slow
@pytest.mark.parametrize(("dead", "seconds"), [(0, 0.3), (1, 0.5), (2, 0.6)])
def test_a_base_dies_in_flight(dead: int, seconds: float) -> None:
    """A base dies at 10 s, at three newtons (base 1) or less: it is named, and the flight goes on."""
    plant = SpaceTruss.consistent()
    diagram = mean_axes_transport(Mission.of_case(1), plant, hardware=Hardware.flight(), seed=1)
    truss, actuators, controller = (diagram.blocks[n] for n in ("truss", "actuators", "controller"))
    diagram.expose(health=actuators.port("base_effectiveness"))
    wanted = diagram.blocks["trajectory"].port("position")
    diagram.expose(
        position=truss.port("task_position"), wanted=wanted, known=controller.port("effectiveness")
    )
    with Session(diagram, step=2e-3) as session:
        session.start(inputs={"health": np.ones(4)})
        session.advance(10.0)
        session.set(health=1.0 - np.eye(4)[dead])
        session.advance(10.0 + seconds)
        known = session.outputs["known"]
        assert (known[GROUPS[dead]] == 0.0).all()
        assert known.sum() == 46.0
        session.advance(20.0)
        found = session.outputs
        assert (found["known"] == known).all()
        assert np.abs(found["position"] - found["wanted"])[:6].max() < 0.01
        assert np.abs(found["position"] - found["wanted"])[6:].max() < 0.2


@pytest.mark.slow
def test_a_path_becomes_slower_where_a_loss_asks_for_it() -> None:
    """Base 4 dies at 10 s: 60 s are beyond reach along body z; attitude and joints are held all the same."""
    mission = Mission.of_case(1)
    plant, limits = SpaceTruss.consistent(), ActuatorLimits.flight()
    path = path_of(mission, plant)
    shares = shares_left(DYNAMICS, path, limits)
    np.testing.assert_array_equal(shares[:3], 1.0)
    diagram = mean_axes_transport(mission, plant, hardware=Hardware.flight(), shares=shares, seed=1)
    truss, trajectory, controller = (diagram.blocks[n] for n in ("truss", "trajectory", "controller"))
    diagram.expose(health=diagram.blocks["actuators"].port("base_effectiveness"))
    diagram.expose(position=truss.port("task_position"), known=controller.port("effectiveness"))
    diagram.expose(wanted=trajectory.port("position"), arrival=trajectory.port("arrival"))
    with Session(diagram, step=2e-3) as session:
        session.start(inputs={"health": np.ones(4)})
        session.advance(10.0)
        assert session.outputs["arrival"] == 60.0
        session.set(health=np.array([1.0, 1.0, 1.0, 0.0]))
        worst = np.zeros(RIGID)
        for time in np.arange(10.5, 40.0, 0.5):
            session.advance(float(time))
            worst = np.maximum(worst, np.abs(session.outputs["position"] - session.outputs["wanted"]))
        assert session.outputs["known"][18:24].max() == 0.0
        assert session.outputs["known"].sum() == 46.0
        assert 200.0 < session.outputs["arrival"] < 280.0
        assert worst[:3].max() < 0.02
        assert worst[3:6].max() < 0.02
        assert worst[6:].max() < 0.3
