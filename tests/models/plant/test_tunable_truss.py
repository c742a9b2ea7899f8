"""A truss given by parameters moves as the one that is built with the same numbers."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Diagram, Simulator
from trussflow.models import Hardware, Measurement, ModelError, SpaceTruss
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.truss.variations import loaded, misjudged, scaled


def other_truss():
    truss = scaled(TrussModes.reconstructed(), mass=0.9, frequency=1.1)
    return misjudged(loaded(truss, truss.positions[-1], 15.0), 1.0 + 0.1 * np.arange(6)).damped(0.003)


@pytest.mark.parametrize("exact", [True, False])
def test_flies_as_the_truss_itself(exact):
    make = TunableTruss.consistent if exact else TunableTruss.published
    tunable, given = make(), other_truss()
    dynamics = tunable.dynamics
    itself = SpaceTruss(
        type(dynamics)(modes=given, arms=dynamics.arms, elastic_integrals=exact),
        modal_actuation=tunable.modal_actuation,
    )
    speeds = np.random.default_rng(3).uniform(-0.02, 0.02, tunable.n)
    found = []
    for plant, values in ((tunable, tunable.truss_parameters(given)), (itself, {})):
        diagram = Diagram("free")
        diagram.add(truss=plant)
        diagram.ground(plant.actuation)
        values = {"initial_speeds": speeds} | values
        run = Simulator(diagram, step=1e-3, log=[plant.coordinates, plant.energy, plant.grasp_displacement])
        found.append(run.run(0.5, progress=False, parameters={f"truss.{k}": v for k, v in values.items()}))
    for port in ("coordinates", "energy", "grasp_displacement"):
        one, two = (result[f"truss.{port}"].values for result in found)
        np.testing.assert_allclose(one, two, rtol=0.0, atol=1e-9 * np.abs(two).max())
    assert np.ptp(found[0]["truss.coordinates"].values[:, 8]) > 1e-4


def test_another_number_of_modes_or_other_grasps_are_refused():
    plant = TunableTruss.consistent()
    with pytest.raises(ModelError, match=r"a truss of 5 modes.*must be the same"):
        plant.truss_parameters(TrussModes.reconstructed().truncated(5))


def test_accelerometers_would_feel_another_truss():
    hardware = replace(Hardware.flight(), accelerometer=Measurement(sample_time=0.02))
    hardware.sensors(SpaceTruss.consistent(), seed=1)
    with pytest.raises(ModelError, match="would feel another truss than the one that flies"):
        hardware.sensors(TunableTruss.consistent(), seed=1)


def test_limits_of_hardware_without_torques():
    truss = SpaceTruss.consistent()
    np.testing.assert_allclose(Hardware.flight().limits(truss)[:6], [5.0] * 3 + [0.3] * 3, rtol=1e-12)
    with pytest.raises(ModelError, match="nothing makes torques on the bases"):
        replace(Hardware.flight(), wheels=None).limits(truss)
