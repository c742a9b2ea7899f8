"""Variations: distributions, combinations, and arguments that are refused."""

import contextlib
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy import stats
from systems import assert_near, decay

from trussflow.blocks import Gain, sweep
from trussflow.blocks.errors import SimulationError, TrussflowError
from trussflow.blocks.sweeps.sweep import sweep as function
from trussflow.blocks.sweeps.variations import SAMPLING_METHODS, drawn

VALUE_LISTS = st.lists(st.lists(st.integers(0, 9), min_size=1, max_size=4), max_size=3)


@given(
    VALUE_LISTS,
    st.integers(0, 3),
    st.integers(1, 20),
    st.sampled_from(["random", "latin", "halton"]),
)
def test_all_combinations_come_with_all_draws(lists, distributions, samples, method):
    if not lists and not distributions:
        return
    vary = {f"a.{k}": values for k, values in enumerate(lists)}
    vary |= {f"b.{k}": stats.uniform(k, 1.0) for k in range(distributions)}
    found = drawn(vary, samples if distributions else None, 1, method)
    rows = list(zip(*(found[f"a.{k}"] for k in range(len(lists))), strict=True))
    count = samples if distributions else 1
    if lists:
        assert rows == [row for row in itertools.product(*lists) for _ in range(count)]
    for k in range(distributions):
        assert ((found[f"b.{k}"] >= k) & (found[f"b.{k}"] <= k + 1)).all()
        first = found[f"b.{k}"][:count]
        assert_array_equal(
            found[f"b.{k}"], np.tile(first, len(found[f"b.{k}"]) // count)
        )


@pytest.mark.parametrize("method", SAMPLING_METHODS)
def test_draws_have_the_distribution_that_was_asked_for(method):
    joint = stats.multivariate_normal([1.0, -2.0], [[0.5, 0.3], [0.3, 0.4]])
    wanted = {
        "a.n": stats.norm(2.0, 0.1),
        "a.l": stats.lognorm(0.5),
        "a.t": stats.truncnorm(-1, 2),
        "a.u": stats.uniform(),
    }
    vary = wanted | {("b.x", "b.y"): joint}
    found = drawn(vary, 1024, 7, method)
    for name, distribution in wanted.items():
        assert stats.kstest(found[name], distribution.cdf).pvalue > 1e-3
    # Of 1024 independent draws the error is 0.5 * 5 / 32 at five standard deviations.
    assert_near(np.cov(found["b.x"], found["b.y"]), joint.cov, 0.08)
    assert_array_equal(found["b.x"], drawn(vary, 1024, 7, method)["b.x"])
    assert (found["b.x"] != drawn(vary, 1024, 8, method)["b.x"]).any()


def test_arrays_vary_together_with_numbers():
    rows = [(k, np.full(3, 10.0 * k), [[k]]) for k in range(4)]
    found = drawn({("a.n", "a.u", "a.m"): rows, "b.n": [0.5, 0.7]}, None, 0, "random")
    assert_array_equal(found["a.n"], [0, 0, 1, 1, 2, 2, 3, 3])
    assert_array_equal(found["a.u"], 10.0 * found["a.n"][:, None] * np.ones(3))
    assert found["a.m"].shape == (8, 1, 1)
    assert_array_equal(found["b.n"], [0.5, 0.7] * 4)


@pytest.mark.parametrize(
    "names, rows, said",
    [
        (("a.n", "a.m"), ["ab", "cd"], "give 2 values for each sample"),
        (("a.n", "a.m"), [b"ab"], "give 2 values for each sample"),
        (("a.n", "a.m"), [np.array(1.0)], "give 2 values for each sample"),
        (("a.n", "a.m"), np.array(1.0), "cannot vary over"),
        (("a.n", "a.n"), [(1.0, 2.0)], "'a.n' varies in two ways"),
        ((), [()], "needs varied values"),
    ],
)
def test_rows_that_are_none_are_refused(names, rows, said):
    with pytest.raises(SimulationError, match=said):
        drawn({names: rows}, None, 0, "random")


def test_more_samples_begin_with_the_same():
    vary = {"a.n": stats.norm(), "a.u": stats.uniform()}
    few, many = drawn(vary, 10, 3, "random"), drawn(vary, 20, 3, "random")
    assert_array_equal(few["a.n"], many["a.n"][:10])


NONSENSE_VALUES = [
    *(
        None,
        True,
        0,
        -1,
        1.5,
        math.nan,
        math.inf,
        10**30,
        1 + 2j,
        "",
        "x",
        b"x",
        object(),
    ),
    *(
        [],
        [[]],
        {},
        {"x": None},
        {1: 2},
        (),
        [None],
        np.nan,
        np.zeros(0),
        np.array("x"),
        lambda: 1,
        Gain(1.0),
    ),
]


ARGUMENTS = {*function.__annotations__} - {"return", "settings", "progress"}
WITHIN = {
    "value": lambda value: {"vary": {"back.gain": value}, "samples": None},
    "kept": lambda value: {"keep": {"x": value}},
    "varied": lambda value: {"vary": {value: [1.0]}, "samples": None},
    "signal": lambda value: {"keep": {value: "max"}},
}
"""Arguments with nonsense within."""


@pytest.mark.parametrize("argument", [*sorted(ARGUMENTS), *WITHIN])
def test_nonsense_is_refused_by_our_errors(argument, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    usual = {
        "model": decay(()),
        "duration": 0.2,
        "vary": {"back.gain": stats.norm()},
        "samples": 2,
        "executor": "serial",
    }
    for value in NONSENSE_VALUES:
        if argument == "duration" and isinstance(value, int) and value > 1:
            continue  # a run that takes so long is no nonsense
        if argument in ("varied", "signal") and value.__hash__ is None:
            continue
        given = WITHIN.get(argument, lambda v: {argument: v})(value)
        with contextlib.suppress(TrussflowError):
            sweep(step=0.1, **usual | given)
