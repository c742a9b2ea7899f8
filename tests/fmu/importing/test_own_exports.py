"""Exported FMUs, imported again: the same numbers as the block in this process."""

import numpy as np
import pytest

from trussflow.blocks import Diagram, Sine, simulate
from trussflow.fmu import Fmu

ROUND_OFF = 1e-12
versions = pytest.mark.parametrize("version", ["2.0", "3.0"])


def driven(plant, duration, step, **options):
    """Return the outputs of three oscillators, driven by sines."""
    diagram = Diagram("driven")
    diagram.add(plant=plant, drive=Sine([1.0, 2.0, 3.0], frequency=2.0, unit="N"))
    diagram.drive >> diagram.plant.force
    result = simulate(diagram, duration, step=step, **options)
    return np.column_stack([result[f"plant.{name}"] for name in ("position", "angle", "total")])


@versions
@pytest.mark.parametrize("solver", ["rk4", "euler"])
def test_model_exchange_equals_the_block(exported, systems, version, solver):
    """Runs by one solver are equal to round-off, with changed parameters too."""
    settings = {"solver": solver, "parameters": {"plant.stiffness": [7.0, 8.0, 9.0]}}
    path = exported(systems.Oscillator(3), version, "three")
    ours, theirs = (
        driven(plant, 1.0, 1e-2, **settings) for plant in (systems.Oscillator(3), Fmu(path, kind="me"))
    )
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=ROUND_OFF)


@versions
def test_ports_come_back_as_they_were(exported, systems, version):
    ours = systems.Oscillator(3)
    theirs = Fmu(exported(ours, version, "three"), kind="cs", step=1e-3)
    for name, port in ours.ports.items():
        assert theirs.ports[name].whole_shape == port.whole_shape
        assert theirs.ports[name].unit == port.unit
    assert theirs.feedthrough() == {"position": (), "angle": (), "total": ()}
    for name, value in ours.parameters.items():
        np.testing.assert_array_equal(theirs.parameters[name], value)
    direct = Fmu(exported(systems.Rotor(), version), kind="cs", step=1e-3)
    assert direct.feedthrough() == {"axes": ("torque",)}


@versions
def test_co_simulation_converges_to_the_block(exported, systems, version):
    """Inputs are held over each step, so the error falls with the step, to first order."""
    path = exported(systems.Oscillator(3), version, "three")
    exact = driven(systems.Oscillator(3), 1.0, 1e-3)[-1, :3]
    errors, steps = [], [1e-2, 5e-3, 2.5e-3]
    for step in steps:
        found = driven(Fmu(path, kind="cs", step=step), 1.0, step)[-1, :3]
        errors.append(np.abs(found - exact).max())
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.1)
