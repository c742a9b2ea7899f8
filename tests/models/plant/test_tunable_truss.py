"""A truss set by parameters moves as the one that is built with the same numbers."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import relative_error, series

from trussflow.blocks import Simulator
from trussflow.models import Hardware, ModelError, SpaceTruss
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.truss.variations import loaded, misjudged, scaled


def other_truss():
    truss = scaled(TrussModes.reconstructed(), mass=0.9, frequency=1.1)
    return misjudged(
        loaded(truss, truss.positions[-1], 15.0), 1.0 + 0.1 * np.arange(6)
    ).damped(0.003)


@pytest.mark.parametrize("exact", [True, False])
def test_moves_as_the_truss_itself(exact):
    make = TunableTruss.consistent if exact else TunableTruss.published
    tunable, truss = make(), other_truss()
    itself = SpaceTruss(
        replace(tunable.dynamics, modes=truss), modal_actuation=tunable.modal_actuation
    )
    speeds = np.random.default_rng(3).uniform(-0.02, 0.02, tunable.n)
    runs = []
    for plant, values in ((tunable, tunable.truss_parameters(truss)), (itself, {})):
        diagram = series(truss=plant)
        diagram.ground(plant.actuation)
        parameters = {f"truss.{name}": value for name, value in values.items()}
        simulator = Simulator(diagram, step=1e-3, log_step=0.02)
        runs.append(
            simulator.run(0.04, parameters=parameters, initial={"truss.v": speeds})
        )
    for port in ("coordinates", "energy", "grasp_displacement"):
        one, two = (run[f"truss.{port}"].values for run in runs)
        assert relative_error(one, two) < 1e-9
    assert np.ptp(runs[0]["truss.coordinates"].values[:, 8]) > 1e-4


@pytest.mark.parametrize(
    "build, message",
    [
        (
            lambda plant: plant.truss_parameters(
                TrussModes.reconstructed().truncated(5)
            ),
            r"a truss of 5 modes.*must be the same",
        )
    ],
)
def test_errors(build, message):
    with pytest.raises(ModelError, match=message):
        build(TunableTruss.consistent())


def test_limits_of_hardware_without_torques():
    truss = SpaceTruss.consistent()
    assert_allclose(
        Hardware.flight().limits(truss)[:6], [5.0] * 3 + [0.3] * 3, rtol=1e-12
    )
    with pytest.raises(ModelError, match="makes no torques on the bases"):
        replace(Hardware.flight(), wheels=None).limits(truss)
