"""A block as an FMU computes what it computes in a compiled run, bit by bit."""

import numpy as np
import pytest
from fmpy import read_model_description

from trussflow.blocks import Diagram, Function, Input, Noise, Output, simulate
from trussflow.fmu import export
from trussflow.models import Hardware, SpaceTruss, mean_axes_controller

SAMPLES = 1000


def shifted(mean):
    return Function(lambda u: u + mean, {"u": Input(mean.size)}, {"y": Output(mean.size)})


def check_same(item, given, step, fmi, folder, samples=SAMPLES):
    """Check all outputs at each step, with noise of these means and deviations at the inputs."""
    diagram = Diagram("loop")
    diagram.add(item=item)
    for seed, (name, (mean, deviation)) in enumerate(given.items()):
        size = np.size(mean)
        noise, source = Noise(np.full(size, deviation), step, seed=seed), shifted(np.ravel(mean))
        diagram.add(**{f"noise_{name}": noise, f"of_{name}": source})
        noise.y >> source.u
        source.y >> item.port(name)
    outputs = [port.name for port in item.outputs()]
    log = [f"item.{name}" for name in outputs] + [f"of_{name}.y" for name in given]
    for port in item.inputs():
        if port.name not in given:
            diagram.ground(port)
    result = simulate(diagram, samples * step, step=step, log=log, progress=False)
    path = export(item, folder / "item.fmu", step=step)
    variables = read_model_description(str(path)).modelVariables
    first: dict[str, int] = {}
    for variable in variables:
        first.setdefault(variable.name.split("[")[0], variable.valueReference)
    with fmi.opened(path, "cs", folder) as fmu:
        now = {first[name]: result[f"of_{name}.y"].values for name in given}
        fmi.started(fmu, {reference: values[0] for reference, values in now.items()})
        for k in range(samples):
            for reference, values in now.items():
                fmi.write(fmu, reference, values[k])
            for name in outputs:
                expected = result[f"item.{name}"].values[k].ravel()
                np.testing.assert_array_equal(
                    fmi.read(fmu, first[name], expected.size), expected, f"{name}, {k}"
                )
            fmu.doStep(k * step, step)


@pytest.mark.slow
def test_a_whole_controller(fmi, tmp_path):
    truss = SpaceTruss.consistent()
    controller = mean_axes_controller(truss.dynamics, Hardware.flight().limits(truss))
    rest = truss.dynamics.rest[:34]
    still = np.zeros(rest.size)
    given = {
        "position": (rest, 1e-3),
        "velocity": (still, 1e-4),
        "reference_position": (rest, 1e-3),
        "reference_velocity": (still, 1e-3),
        "reference_acceleration": (still, 1e-3),
        "actuation": (np.zeros(52), 0.05),
        "propellant": (np.ones(4), 0.2),
        "momentum": (np.zeros(12), 3.0),
    }
    check_same(controller, given, 0.02, fmi, tmp_path)


def test_a_sampled_loop_around_continuous_states(systems, fmi, tmp_path):
    check_same(systems.hybrid(), {"target": (np.zeros(1), 1.0)}, 0.01, fmi, tmp_path)
