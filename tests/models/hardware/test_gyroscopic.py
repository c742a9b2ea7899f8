"""Rotors on bases that turn: their momentum is part of the angular momentum of the whole."""

from dataclasses import replace

import numpy as np
from systems import assert_near

from trussflow.blocks import Diagram, simulate
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.transport import MissionFile

SOLVER_ERROR = 1e-9
"""Error of the solver, relative to the whole."""

ROTORS = {1: np.array([2.0, -1.0, 3.0]), 2: np.array([-3.0, 0.5, 1.0])}  # N*m*s


def tumbling(dynamics, *, gyroscopic):
    """Return angular momentum with rotors about the origin, and energy, of a truss that tumbles."""
    truss = SpaceTruss(dynamics)
    hardware = replace(Hardware.exact(0.02), gyroscopic=gyroscopic)
    diagram = Diagram("rotors")
    plant, actuators = diagram.add(truss=truss, actuators=hardware.actuators(truss))
    diagram.ground(actuators.command)
    actuators.actuation >> plant.actuation
    if gyroscopic != "off":
        plant.actuator_rates >> actuators.rates
    speeds = np.zeros(truss.n)
    speeds[:6] = 0.1, 0.0, -0.2, 0.05, 0.1, -0.08
    held = {f"actuators.wheels_{k}.h": h for k, h in ROTORS.items()}
    result = simulate(
        diagram,
        2.0,
        step=0.02,
        log=[plant.coordinates, plant.speeds, plant.energy],
        initial={"truss.v": speeds, **held},
    )
    found = []
    for q, v in zip(
        result["truss.coordinates"].values, result["truss.speeds"].values, strict=True
    ):
        turn, bases = (
            dynamics.attitude.rotation(q[3:6]),
            dynamics.evaluate(q, v).base_rotations,
        )
        rotors = sum(
            turn @ base @ h for base, h in zip(bases, ROTORS.values(), strict=True)
        )
        found.append(dynamics.momentum(q, v)[1] + rotors)
    return np.array(found), result["truss.energy"].values


def test_angular_momentum_of_truss_and_rotors_is_conserved(random_system):
    """And so is energy, for what rotors add does no work; left out, a thirtieth of the momentum is lost."""
    system = random_system(("RPR", ""), 3, elastic_integrals=True)
    momentum, energy = tumbling(system, gyroscopic="on")
    assert_near(momentum - momentum[0], 0.0, SOLVER_ERROR * np.abs(momentum).max())
    assert np.ptp(energy) < SOLVER_ERROR * energy[0]
    without, _ = tumbling(system, gyroscopic="off")
    assert np.abs(without - without[0]).max() > 0.02 * np.abs(without).max()


def test_a_mission_file_asks_for_them(tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(
        'title = "rotors"\nextends = "case_1.toml"\n[hardware]\nkind = "flight"\n'
        '[wheels]\ngyroscopic = "on"\n[controller]\nlaw = "mean axes"\n'
        '[structure]\nmodel = "consistent"\n[path]\nduration = "60 s"\n'
    )
    diagram = MissionFile.read(path).diagram()
    assert "rates" in diagram.blocks["actuators"].ports
    path.write_text(path.read_text().replace('"on"', '"off"'))
    assert "rates" not in MissionFile.read(path).diagram().blocks["actuators"].ports
