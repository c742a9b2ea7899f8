"""Tables interpolate linearly; outside they hold the end values, or go on if asked to."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.interpolate import RegularGridInterpolator
from systems import assert_near

from trussflow.blocks import GridTable, Table, TimeTable

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
numbers = st.floats(-100.0, 100.0)
tables = st.lists(
    st.tuples(numbers, numbers),
    min_size=2,
    max_size=8,
    unique_by=lambda row: round(row[0], 1),
).map(lambda rows: np.array(sorted(rows)).T)


@given(table=tables, x=st.lists(st.floats(-200.0, 200.0), min_size=1, max_size=5))
def test_table_agrees_with_numpy(table, x, evaluate):
    points, values = table
    found = evaluate(Table(points, values), u=x)["y"]
    assert_near(found, np.interp(x, points, values), 1e-10)


@given(table=tables)
def test_time_table_passes_its_points(table, evaluate):
    times, values = table
    rows = np.stack([values, -values], axis=1)
    block = TimeTable(times, rows)
    found = [evaluate(block, t)["y"] for t in times]
    assert_near(found, rows, 1e-10)
    assert block.breakpoints() == tuple(times)


def test_extrapolation_goes_on_straight(evaluate):
    table = Table([0.0, 1.0, 3.0], [0.0, 2.0, 1.0], extrapolate=True)
    found = evaluate(table, u=[-1.0, 0.5, 5.0])["y"]
    assert_allclose(found, [-2.0, 1.0, 0.0], rtol=ROUND_OFF)


def test_nan_stays_nan(evaluate):
    assert np.isnan(evaluate(Table([0.0, 1.0], [0.0, 1.0]), u=np.nan)["y"])


def test_grid_is_that_of_scipy(respond, rng):
    axes = [
        np.array([0.0, 0.5, 2.0]),
        np.array([-1.0, 1.0]),
        np.array([0.0, 1.0, 3.0, 4.0]),
    ]
    values = rng.normal(size=(3, 2, 4, 2))
    for extrapolate in (False, True):
        exact = RegularGridInterpolator(
            axes, values, bounds_error=False, fill_value=None
        )
        for point in rng.uniform(-1.5, 4.5, (10, 3)):
            table = GridTable(
                axes, values, extrapolate=extrapolate, units=["m", "s", "1"]
            )
            found = respond(table, 0.01, u1=point[0], u2=point[1], u3=point[2])[
                "block.y"
            ][0]
            inside = (
                point
                if extrapolate
                else [np.clip(x, a[0], a[-1]) for x, a in zip(point, axes, strict=True)]
            )
            assert_near(found, exact(inside)[0], 1e-12)
