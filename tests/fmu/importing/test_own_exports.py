"""What `export` writes, imported again: the same numbers as the block in this process."""

from __future__ import annotations

import numpy as np
import pytest

from trussflow.blocks import Block, Diagram, Input, Output, Parameter, Sine, State, simulate
from trussflow.fmu import Fmu, export

ROUND_OFF = 1e-12
versions = pytest.mark.parametrize("version", ["2.0", "3.0"])


class Chain(Block):
    """Three masses on hardening springs, with vectors in and out."""

    force = Input(3, unit="N")
    position = Output(3, unit="m")
    power = Output(unit="W")
    q = State(3, unit="m", initial="start")
    v = State(3, unit="m/s")
    stiffness = Parameter([4.0, 5.0, 6.0], (3,), unit="N/m")
    start = Parameter([0.1, -0.2, 0.3], (3,), unit="m")

    def output(self, t, x, u, p):
        return {"position": x.q, "power": u.force @ x.v}

    def derivative(self, t, x, u, p):
        spring = p.stiffness * (x.q + x.q**3)
        return {"q": x.v, "v": u.force - spring + 0.5 * np.sin(t) * np.ones(3)}


def driven(plant):
    diagram = Diagram("driven")
    diagram.add(plant=plant, drive=Sine([1.0, 2.0, 3.0], frequency=2.0, unit="N"))
    diagram.drive >> diagram.plant.force
    return diagram


@versions
@pytest.mark.parametrize("solver", ["rk4", "euler"])
def test_model_exchange_equals_the_block(tmp_path, version, solver):
    """The same solver takes the same stages: equal to round-off, parameters changed too."""
    path = export(Chain(), tmp_path / "chain.fmu", version=version)
    values = {"plant.stiffness": [7.0, 8.0, 9.0]}
    ours, theirs = (
        simulate(driven(plant), 2.0, step=1e-2, solver=solver, parameters=values)
        for plant in (Chain(), Fmu(path, kind="me"))
    )
    for name in ("plant.position", "plant.power"):
        np.testing.assert_allclose(theirs[name], ours[name], rtol=0, atol=ROUND_OFF)


@versions
def test_ports_come_back_as_they_were(tmp_path, version):
    chain = Chain()
    block = Fmu(export(chain, tmp_path / "chain.fmu", version=version), kind="cs", step=1e-3)
    for name, port in chain.ports.items():
        assert block.ports[name].whole_shape == port.whole_shape
        assert block.ports[name].unit == port.unit
    assert block.feedthrough() == {"position": (), "power": ("force",)}
    np.testing.assert_array_equal(block.parameters["start"], chain.parameters["start"])


@versions
def test_co_simulation_converges_to_the_block(tmp_path, version):
    """Inputs are held over each step, so the error falls with the step, to first order."""
    path = export(Chain(), tmp_path / "chain.fmu", version=version)
    exact = simulate(driven(Chain()), 1.0, step=1e-3)["plant.position"][-1].values
    errors, steps = [], [4e-2, 2e-2, 1e-2, 5e-3]
    for step in steps:
        result = simulate(driven(Fmu(path, kind="cs", step=step)), 1.0, step=step)
        errors.append(np.abs(result["plant.position"][-1].values - exact).max())
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.1)


def test_a_python_fmu_gives_the_same(tmp_path):
    """Both kinds of export, imported for co-simulation, step by step."""
    native, python = (
        simulate(
            driven(Fmu(export(Chain(), tmp_path / f"{kind}.fmu", kind=kind), kind="cs", step=1e-2)),
            0.5,
            step=1e-2,
        )
        for kind in ("native", "python")
    )
    for name in ("plant.position", "plant.power"):
        np.testing.assert_allclose(python[name], native[name], rtol=0, atol=ROUND_OFF)
