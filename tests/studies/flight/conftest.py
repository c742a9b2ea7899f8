"""Fixtures of the tests of the robustness study."""

from functools import cache
from types import SimpleNamespace

import campaign
import numpy as np
import pytest
import systems
import xarray as xr
from flight import loops, tuning
from flight.loops import flight_simulator
from flight.metrics import GOALS
from flight.tuning import INITIAL

from trussflow.models.plant.tunable_truss import TunableTruss

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)


@pytest.fixture(params=["consistent", "accurate"][: campaign.SIZE])
def plant(request, monkeypatch):
    """Prepare the tuned loop once; the campaign of CI has six modes, a larger one more too."""
    monkeypatch.setattr(TunableTruss, "accurate", getattr(TunableTruss, request.param))
    prepared = cache(flight_simulator)
    for module in (loops, tuning):  # runs are pickled by the name in the first
        monkeypatch.setattr(module, "flight_simulator", prepared)
    return request.param


@pytest.fixture
def tuned():
    """Return a result of the search, and four runs of each design: one of the first diverges."""
    errors = np.array(
        [[2.0, 3.0, 4.0, np.nan], [1.0, 2.0, 3.0, 4.0], [0.5, 1.0, 1.5, 2.0]]
    )
    compared = {}
    for name, position in zip(("initial", "shipped", "tuned"), errors, strict=True):
        force = np.where(position == 3.0, 0.2, 0.1)
        columns = dict.fromkeys(GOALS, np.zeros(4))
        columns |= {"position": 1e-3 * position, "late force": force}
        data = {metric: ("sample", values) for metric, values in columns.items()}
        runs = {"sample": [2000, 2001, 2002, 2003]}
        compared[name] = xr.Dataset(data, runs, INITIAL | {"disk": 0.25})
    found = SimpleNamespace(
        before=0.3,
        cost=0.25,
        limits={"share": np.array([0.8])},
        runs=400,
        message="The end.",
    )
    return found, compared
