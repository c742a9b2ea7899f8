"""What a study of a tuned design may have found."""

from functools import cache, partial

import numpy as np
import pytest
import systems
import xarray as xr
from flight import samples
from flight import tuned as tuned_study
from flight.flights import Flights
from flight.measures import UNITS
from flight.tuned import RANGES, Tuning

from trussflow.blocks import sweep
from trussflow.models.plant.tunable_truss import TunableTruss

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)


@pytest.fixture(params=["consistent", pytest.param("accurate", marks=pytest.mark.campaign)])
def plant(request, monkeypatch):
    """Prepare each study once, and run it in this process; ordinary ones with six modes."""
    monkeypatch.setattr(TunableTruss, "accurate", getattr(TunableTruss, request.param))
    monkeypatch.setattr(tuned_study, "Flights", cache(Flights))
    monkeypatch.setattr(samples, "sweep", partial(sweep, executor="serial"))
    return request.param


@pytest.fixture
def tuned():
    """Return four flights by each design: of the first, one is lost, and one needs two steps of thrust."""
    study = Tuning(others=range(2000, 2004))
    errors = np.array([[2.0, 3.0, 4.0, np.nan], [1.0, 2.0, 3.0, 4.0], [0.5, 1.0, 1.5, 2.0]])
    columns = {name: (("design", "seed"), np.zeros((3, 4))) for name in UNITS}
    columns |= {"position": (("design", "seed"), 1e-3 * errors), "share": (("design", "seed"), errors / 10.0)}
    columns["late force"] = ("design", "seed"), np.array([[0.1, 0.2, 0.1, np.nan], [0.1] * 4, [0.1] * 4])
    found = xr.Dataset(
        {**columns, **{name: ("design", np.full(3, begin)) for name, (_, begin, _) in RANGES.items()}},
        {"design": ["by hand", "shipped", "tuned"], "seed": [*study.others]},
        {"before": 0.3, "cost": 0.25, "most": 0.8, "runs": 400, "message": "The end."},
    )
    return study, found.assign(disk=("design", [0.24, 0.26, 0.25]))
