"""The solver's settings: one place, and misspelt ones are named wherever they are given."""

import pytest
from systems import ring

from trussflow.blocks import (
    CoSimulator,
    Integrator,
    Session,
    Simulator,
    cosimulate,
    operating_point_after,
    simulate,
)
from trussflow.blocks.errors import SimulationError


def growth():
    return ring(i=Integrator(1.0))


USERS = {
    "simulate": lambda **s: simulate(growth(), 1.0, **s),
    "Simulator": lambda **s: Simulator(growth(), **s),
    "Session": lambda **s: Session(growth(), **s),
    "cosimulate": lambda **s: cosimulate(growth(), 1.0, **({"step": 0.1} | s)),
    "CoSimulator": lambda **s: CoSimulator(growth(), **({"step": 0.1} | s)),
    "operating_point_after": lambda **s: operating_point_after(growth(), 1.0, **s),
}


@pytest.mark.parametrize("user", USERS)
@pytest.mark.parametrize(
    "given, meant",
    [
        ("stepp", "step"),
        ("solvr", "solver"),
        ("back_end", "backend"),
        ("rtoll", "rtol"),
    ],
)
def test_misspelt_settings_are_named(user, given, meant):
    message = (
        rf"unknown setting '{given}'; there are: .*{meant}.*; did you mean '{meant}'"
    )
    with pytest.raises(SimulationError, match=message):
        USERS[user](**{given: 0.1})


def test_settings_that_resemble_nothing_are_named_too():
    with pytest.raises(
        SimulationError, match=r"unknown setting 'colour'; there are: step, .*log_step"
    ):
        USERS["simulate"](colour="red")


@pytest.mark.parametrize(
    "settings, message",
    [
        (
            {"step": 0.1, "solver": "rk5"},
            "unknown solver 'rk5'; choose from: rk4, euler, RK45",
        ),
        ({"step": 0.1, "backend": "fast"}, "unknown backend 'fast'; choose from: auto"),
        ({"solver": "BDF"}, "no solver 'BDF' .* use 'Rodas5P'"),
        ({}, r"solver 'rk4' needs a step, such as step=1e-3"),
    ],
)
def test_settings_that_make_no_sense(settings, message):
    with pytest.raises(SimulationError, match=message):
        USERS["simulate"](**settings)
