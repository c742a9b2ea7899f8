"""Measures on signals whose measures are known."""

import numpy as np
import pytest
import xarray as xr
from reproduction.measures import force_shares, largest_jump, late, norm, rates, ripple

TIME = np.arange(0.0, 8.0 + 1e-9, 0.005)


def signal(*components):
    return xr.DataArray(np.stack(components, axis=1), {"time": TIME}, ("time", "axis"))


def test_ripple_is_the_root_mean_square_of_what_is_fast():
    """A drift and a slow swing do not count; switching at every instant counts in full."""
    switching = 0.3 * (-1.0) ** np.arange(len(TIME))
    assert ripple(signal(TIME, 2 - TIME)) == pytest.approx(0.0, abs=1e-12)
    assert ripple(signal(np.sin(0.5 * TIME), switching)) == pytest.approx(0.3, rel=0.03)
    fast = np.sin(2 * np.pi * 20 * TIME)
    assert ripple(signal(fast, fast)) == pytest.approx(1.0, rel=0.05)  # sqrt(1/2 + 1/2)


def test_rates_and_jumps():
    ramp = signal(3 * TIME, 4 * TIME)
    assert rates(ramp) == pytest.approx(5.0)
    assert largest_jump(ramp) == pytest.approx(4 * 0.005)
    assert norm(ramp)[-1] == pytest.approx(40.0)


def test_late_is_the_last_eighth():
    part = late(signal(TIME).to_dataset(name="x"))
    assert part["time"].values[[0, -1]] == pytest.approx([7.0, 8.0])


def test_force_shares_are_of_the_peaks_of_norms():
    force = np.zeros((2, 2, 3))
    force[0, 0] = [3, 4, 0]
    force[1, 1] = [0, 0, -15]
    result = xr.Dataset({"base_force": (("time", "robot", "axis"), force)})
    assert force_shares(result) == pytest.approx([0.25, 0.75])
