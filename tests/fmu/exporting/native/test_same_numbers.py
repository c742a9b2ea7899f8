"""A block as an FMU computes what it computes in a compiled run, bit by bit."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import series

from trussflow.blocks import Noise, simulate
from trussflow.fmu import export
from trussflow.models import Hardware, SpaceTruss, mean_axes_controller


def check_same(item, given, step, instance, folder, samples):
    """Check all outputs at each step, with noise of these means and deviations at the inputs."""
    diagram = series(item=item)
    for seed, (name, (mean, deviation)) in enumerate(given.items()):
        noise = diagram.add(name, Noise(np.full(mean.size, deviation), step, seed=seed))
        (noise.y + mean) >> item.port(name)
    outputs = [port.name for port in item.outputs()]
    for port in item.inputs():
        if port.name not in given and port.declaration.default is None:
            diagram.ground(port)
    log = [f"item.{name}" for name in outputs] + [f"{name}.y" for name in given]
    result = simulate(diagram, samples * step, step=step, log=log)
    values = {
        name: result[f"{name}.y"].values + mean for name, (mean, _) in given.items()
    }
    one = instance(export(item, folder / "item.fmu", step=step))
    one.start({name: rows[0] for name, rows in values.items()})
    for k in range(samples):
        one.set({name: rows[k] for name, rows in values.items()})
        for name in outputs:
            expected = result[f"item.{name}"].values[k].ravel()
            assert_array_equal(one.get(name), expected)
        one.doStep(k * step, step)


@pytest.mark.campaign
def test_a_whole_controller(instance, tmp_path):
    truss = SpaceTruss.consistent()
    controller = mean_axes_controller(truss.dynamics, Hardware.flight().limits(truss))
    rest = truss.dynamics.rest[:34]
    given = {
        "position": (rest, 1e-3),
        "velocity": (np.zeros(34), 1e-4),
        "reference_position": (rest, 1e-3),
        "reference_velocity": (np.zeros(34), 1e-3),
        "reference_acceleration": (np.zeros(34), 1e-3),
        "actuation": (np.zeros(52), 0.05),
        "propellant": (np.ones(4), 0.2),
        "momentum": (np.zeros(12), 3.0),
    }
    check_same(controller, given, 0.02, instance, tmp_path, 1000)


def test_a_sampled_loop_around_continuous_states(systems, instance, tmp_path):
    check_same(
        systems.hybrid(), {"target": (np.zeros(1), 1.0)}, 0.01, instance, tmp_path, 200
    )
