"""Energy audits: supplied is stored or dissipated; an error in a block or a wire shows where it is."""

import numpy as np
import pytest
import systems
from systems import assert_near, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    EnergyAccount,
    Input,
    Mode,
    Output,
    Parameter,
    Sine,
    State,
    Sum,
    ZeroOrderHold,
)
from trussflow.blocks.errors import BlockError, SimulationError
from trussflow.blocks.testing import energy_audit


class Mass(Block):
    """It carries its own damper, between it and the ground."""

    force, velocity = Input(unit="N"), Output(unit="m/s")
    energy, loss = Output(unit="J"), Output(unit="W")
    v = State(unit="m/s", initial=1.0)
    mass, damping = Parameter(2.0, unit="kg"), Parameter(0.3, unit="N*s/m")
    energy_account = EnergyAccount(
        supplied=[("force", "velocity")], stored="energy", dissipated="loss"
    )

    def output(self, t, x, u, p):
        return {
            "velocity": x.v,
            "energy": p.mass * x.v**2 / 2,
            "loss": p.damping * x.v**2,
        }

    def derivative(self, t, x, u, p):
        return {"v": (u.force - p.damping * x.v) / p.mass}


class Spring(Block):
    velocity, force, energy = Input(unit="m/s"), Output(unit="N"), Output(unit="J")
    length = State(unit="m")
    stiffness = Parameter(8.0, unit="N/m")
    energy_account = EnergyAccount(supplied=[("velocity", "force")], stored="energy")

    def output(self, t, x, u, p):
        return {
            "force": p.stiffness * x.length,
            "energy": p.stiffness * x.length**2 / 2,
        }

    def derivative(self, t, x, u, p):
        return {"length": u.velocity}


class WrongSpring(Spring):
    def derivative(self, t, x, u, p):
        return {"length": -u.velocity}


SETTINGS = {"step": 5e-3, "backend": "interpreted"}


def audit(spring, signs="+-", **settings):
    """Return the audit of 1 s of mass and spring, driven by a force that a sampler holds."""
    diagram = Diagram("oscillator")
    wave, hold, total, mass, _ = diagram.add(
        wave=Sine(5.0, 0.7),
        hold=ZeroOrderHold(0.1),
        total=Sum(signs),
        mass=Mass(),
        spring=spring,
    )
    wave >> hold >> total.u1
    spring.force >> total.u2
    total >> mass.force
    mass.velocity >> spring.velocity
    return energy_audit(
        diagram, 1.0, supplied=[(hold.y, mass.velocity)], **(SETTINGS | settings)
    )


@pytest.mark.parametrize(
    "more",
    [{}, {"solver": "DOP853", "rtol": 1e-11}, {"backend": "numpy", "step": 0.01}],
)
def test_energy_is_kept_to_the_error_of_the_solver(more):
    found = audit(Spring(), **more)
    found.raise_for_missing(1e-8)
    assert list(found.drift) == ["mass", "spring", "oscillator"]
    end = found.result.isel(time=-1).sel(account="oscillator")
    supplied, stored, dissipated = (
        float(end[name]) for name in ("supplied", "stored", "dissipated")
    )
    assert supplied == pytest.approx(stored + dissipated, rel=1e-7)
    assert abs(supplied) > 0.1
    assert dissipated > 0.1


def test_a_wrong_sign_in_a_block_and_one_in_a_wire_are_told_apart():
    block, wire = audit(WrongSpring()).drift, audit(Spring(), "++").drift
    assert block["spring"] > 0.1
    assert block["mass"] < 1e-7
    assert block["oscillator"] > 0.1
    assert wire["spring"] < 1e-7
    assert wire["mass"] < 1e-7
    assert wire["oscillator"] > 0.1
    with pytest.raises(
        SimulationError, match=r"exceeds 1e-06: energy audit of 1 s\n  mass .*drift"
    ):
        audit(Spring(), "++").raise_for_missing(1e-6)


class Tug(Mass):
    """A mass that pulls a load; half of its losses are heat of the load."""

    load, losses = Input(unit="N"), Output(2, unit="W")
    energy_account = EnergyAccount(
        supplied=[("force", "velocity")],
        delivered=[("load", "velocity")],
        stored="energy",
        dissipated="losses",
    )

    def output(self, t, x, u, p):
        values = super().output(t, x, u, p)
        return values | {"losses": np.stack([values["loss"], values["loss"]]) / 2}

    def derivative(self, t, x, u, p):
        return {"v": (u.force - u.load - p.damping * x.v) / p.mass}


def test_steady_power_is_supplied_delivered_or_dissipated():
    """At the steady speed of (5 - 2) N / 0.3 N s/m every term is power times time."""
    diagram = Diagram("drive")
    force, load, tug = diagram.add(force=Constant(5.0), load=Constant(2.0), tug=Tug())
    force >> tug.force
    load >> tug.load
    audit = energy_audit(diagram, 2.0, initial={"tug.v": 10.0}, **SETTINGS)
    end = audit.result.isel(time=-1).sel(account="tug")
    values = [end[name] for name in ("supplied", "stored", "dissipated", "missing")]
    assert_near(values, [2.0 * (50.0 - 20.0), 0.0, 2.0 * 30.0, 0.0], 1e-9)


class Ball(systems.Ball):
    """A ball of 1 kg, which counts the energy that its bounces take."""

    energy, lost = Output(unit="J"), Output(unit="J")
    heat = Mode()
    energy_account = EnergyAccount(stored="energy", dissipated="lost")

    def output(self, t, x, u, p):
        values = {"energy": 10.0 * x.z + x.v**2 / 2, "lost": x.heat}
        return super().output(t, x, u, p) | values

    def on_event(self, t, x, u, p, fired):
        return super().on_event(t, x, u, p, fired) | {"heat": x.heat + 0.375 * x.v**2}


def test_energy_that_an_event_takes_away_is_counted():
    """Of 10 J a bounce leaves a quarter; without the count as much is missing."""
    diagram = series(ball=Ball())
    energy_audit(diagram, 0.8, step=1e-2, backend="interpreted").raise_for_missing(
        1e-10
    )
    forgetful = {"ball": EnergyAccount(stored=diagram.ball.energy)}
    found = energy_audit(
        diagram, 0.8, step=1e-2, backend="interpreted", accounts=forgetful
    )
    assert found.drift["ball"] == pytest.approx(0.75, abs=1e-9)


def test_account_errors():
    diagram = Diagram("oscillator")
    mass, one = diagram.add(mass=Mass(), one=Constant(1.0))
    one >> mass.force
    for accounts, message in (
        (
            {"mass": EnergyAccount(supplied=[(mass.force, mass.loss)])},
            r"no power pair: of their product, unit",
        ),
        (
            {"mass": EnergyAccount(stored=mass.loss)},
            r"cannot use 'mass.loss'.*as stored energy of 'mass'.*'W'",
        ),
        (
            {"mass": EnergyAccount(dissipated=mass.velocity)},
            r"cannot use 'mass.velocity'.*as dissipated energy of",
        ),
        ({"mass": 1.0}, r"cannot audit 'mass' by 1\.0: give EnergyAccounts by name"),
        ({"oscillator": EnergyAccount()}, "cannot audit 'oscillator' by"),
    ):
        with pytest.raises(
            (BlockError, SimulationError, AttributeError), match=message
        ):
            energy_audit(diagram, 1.0, accounts=accounts, **SETTINGS)
    with pytest.raises(BlockError, match=r"'force' is no pair of ports; give tuples"):
        EnergyAccount(supplied=("force", "velocity"))
    wide = Diagram("wide")
    constant, other = wide.add(
        constant=Constant(np.ones(2)), other=Constant(np.ones(3))
    )
    with pytest.raises(BlockError, match="they have 2 and 3 elements"):
        energy_audit(
            wide,
            1.0,
            accounts={"a": EnergyAccount(supplied=[(constant.y, other.y)])},
            **SETTINGS,
        )
    with pytest.raises(SimulationError, match="no block in it has an energy_account"):
        energy_audit(wide, 1.0, **SETTINGS)
