"""Fixtures of the tests of the robustness study."""

from functools import cache

import campaign
import numpy as np
import pytest
import systems
import xarray as xr
from flight import tuning
from flight.loops import flight_simulator
from flight.metrics import METRICS
from flight.tuning import INITIAL

from trussflow.models.plant.tunable_truss import TunableTruss

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)


@pytest.fixture(params=["consistent", "accurate"][: campaign.SIZE])
def plant(request, monkeypatch):
    """Prepare the tuned loop once; the campaign of CI has six modes, a larger one more too."""
    monkeypatch.setattr(TunableTruss, "accurate", getattr(TunableTruss, request.param))
    monkeypatch.setattr(tuning, "flight_simulator", cache(flight_simulator))
    return request.param


@pytest.fixture
def tuned():
    """Return four runs of each design: one of the first diverges, and one needs two steps of thrust."""
    errors = np.array(
        [[2.0, 3.0, 4.0, np.nan], [1.0, 2.0, 3.0, 4.0], [0.5, 1.0, 1.5, 2.0]]
    )
    columns = {name: (("design", "seed"), np.zeros((3, 4))) for name in METRICS}
    columns |= {
        "position": (("design", "seed"), 1e-3 * errors),
        "share": (("design", "seed"), errors / 10.0),
    }
    columns["late force"] = (
        ("design", "seed"),
        np.array([[0.1, 0.2, 0.1, np.nan], [0.1] * 4, [0.1] * 4]),
    )
    found = xr.Dataset(
        {
            **columns,
            **{name: ("design", np.full(3, begin)) for name, begin in INITIAL.items()},
        },
        {"design": ["initial", "shipped", "tuned"], "seed": [2000, 2001, 2002, 2003]},
        {
            "before": 0.3,
            "cost": 0.25,
            "most": 0.8,
            "runs": 400,
            "message": "The end.",
            "duration": 100.0,
        }
        | {"first": 0, "last": 15},
    )
    return found.assign(disk=("design", [0.24, 0.26, 0.25]))
