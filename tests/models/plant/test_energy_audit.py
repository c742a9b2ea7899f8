"""The work of the actuators on the truss is stored or damped; the audit finds a wrong sign anywhere."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Diagram, Input, Output
from trussflow.blocks.library.algebra import Function
from trussflow.blocks.testing import energy_audit
from trussflow.models import SpaceTruss

STEP = 2e-3
"""The fastest mode has 0.5 Hz, arms of some kg are light: the fourth order leaves some 1e-9."""


def audit(dynamics, *, wire=1.0, modal_actuation=True):
    """Return the audit of a tumbling truss whose bases have rate feedback, through a wire."""
    truss = SpaceTruss(dynamics, modal_actuation=modal_actuation)
    rng = np.random.default_rng(5)
    q, v = 0.1 * rng.standard_normal((2, truss.n))
    start = {"truss.q": truss.dynamics.rest + q, "truss.v": v}
    size = truss.actuators
    loop = Diagram("truss loop")
    ports = (
        {"rates": Input(size, unit=truss.actuator_rate_units)},
        {"force": Output(size, unit=truss.actuator_units)},
    )
    law = Function(lambda rates: 0.3 * np.sin(np.arange(size)) - 2.0 * rates, *ports)
    plant, feedback = loop.add(truss=truss, feedback=law)
    plant.actuator_rates >> feedback.rates
    (wire * feedback.force) >> plant.actuation
    supplied = [(feedback.force, plant.actuator_rates)]
    return energy_audit(
        loop,
        0.04,
        step=STEP,
        initial=start,
        supplied=supplied,
        log_step=0.01,
        backend="numpy",
    )


@pytest.fixture
def dynamics(random_system):
    system = random_system(("RR", "P"), 2, elastic_integrals=True)
    return replace(system, modes=system.modes.damped(0.3))


def test_supplied_is_stored_or_damped_away(dynamics):
    result = audit(dynamics)
    result.raise_for_missing(1e-9)
    energies = result.result.isel(time=-1).sel(account="truss")
    assert energies["dissipated"] > 1e-4
    assert abs(energies["supplied"]) > 1e-3


@pytest.mark.parametrize("fault", [{"wire": -1.0}, {"modal_actuation": False}])
def test_a_wrong_sign_is_found_where_it_is(dynamics, fault):
    """With modal rows missing the plant does not balance; with a wrong wire only the whole does not."""
    drift = audit(dynamics, **fault).drift
    assert drift["truss loop"] > 1e-4
    assert drift["truss"] < 1e-9 if "wire" in fault else drift["truss"] > 1e-4
