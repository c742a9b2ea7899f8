"""Sampling: conversion of grids, lists and distributions to the values of each sample."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Mapping, Sequence
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import (
    by_name,
    is_whole,
    one_of,
    positive_whole,
    shown,
)

MOST_SAMPLES = 100_000_000
"""Largest number of samples; a larger one is an error [-]."""

ENGINES = {"latin": "LatinHypercube", "sobol": "Sobol", "halton": "Halton"}
"""Classes of `scipy.stats.qmc` by sampling method."""

SAMPLING_METHODS = "random", *ENGINES
"""Sampling methods of uniform numbers, which distributions transform."""

WHAT = "varied values"
Vary = Mapping[Any, Any]
"""Distributions, or sequences of values, by name, or by several names that vary together."""


def drawn(
    vary: Vary, samples: int | None, seed: int, method: str
) -> dict[str, NDArray[Any]]:
    """Return the values of each name for all samples.

    Sequences form a full grid, in which the last varies fastest. Each grid point has the same `samples`
    of the distributions.

    Parameters
    ----------
    vary : mapping
        Distributions and sequences by name.
    samples : int, optional
        Number of samples of the distributions [-].
    seed : int
        Seed of the random numbers [-].
    method : str
        ``"random"``, or ``"latin"``, ``"sobol"`` or ``"halton"`` of `scipy.stats.qmc`.

    Raises
    ------
    SimulationError
        If an argument is not allowed, or all samples of a distribution are equal.
    """
    one_of("sampling method", method, SAMPLING_METHODS)
    if not is_whole(seed) or seed < 0:
        raise SimulationError(
            f"the seed {shown(seed)} must be a whole number, zero or positive"
        )
    named = by_name(WHAT, vary, str | tuple)
    each = Counter(name for names in named for name in _each(names))
    by_name(WHAT, each)
    if twice := sorted(name for name, number in each.items() if number > 1):
        raise SimulationError(f"'{twice[0]}' varies in two ways; give it once")
    if not vary or () in vary:
        raise SimulationError(
            f"a sweep needs varied values, as {{'block.parameter': values}}, not {shown(vary)}"
        )
    random = {names: d for names, d in vary.items() if _is_distribution(d)}
    lists = {
        names: _listed(names, values)
        for names, values in vary.items()
        if names not in random
    }
    if (samples is None) == bool(random):
        wrong = (
            "needs samples=..., how many are drawn"
            if random
            else "takes no samples: no distribution varies"
        )
        raise SimulationError(f"this sweep {wrong}")
    if samples is not None:
        positive_whole(samples=samples)
        if samples > MOST_SAMPLES:
            raise SimulationError(
                f"{samples} samples are too many; the largest number is {MOST_SAMPLES}"
            )
    count = samples or 1
    lengths = [len(next(iter(own.values()))) for own in lists.values()]
    combinations = prod(lengths)
    # The samples of the distributions are one more axis, the fastest one.
    grid = np.arange(combinations * count)
    found: dict[str, NDArray[Any]] = {}
    repeats = grid.size
    for own, length in zip(lists.values(), lengths, strict=True):
        repeats //= length
        chosen = grid // repeats % length
        found |= {name: values[chosen] for name, values in own.items()}
    for names, values in _draws(random, count, seed, method).items():
        if count > 1 and (values == values[:1]).all():
            raise SimulationError(
                f"the distribution of {_quoted(names)} gives {shown(values[0])} in all samples"
            )
        # The same samples at each grid point, so that points can be compared.
        values = np.tile(values, (combinations, *[1] * (values.ndim - 1)))
        found |= (
            {names: values} if isinstance(names, str) else _columns(names, [*values])
        )
    return found


def _is_distribution(thing: Any) -> bool:
    return hasattr(thing, "rvs") or hasattr(thing, "icdf")


def _each(names: str | tuple[str, ...]) -> tuple[str, ...]:
    return names if isinstance(names, tuple) else (names,)


def _quoted(names: str | tuple[str, ...]) -> str:
    return ", ".join(f"'{name}'" for name in _each(names))


def _are_several(values: Any) -> bool:
    """Return whether the argument is a sequence or array of values."""
    is_text = isinstance(values, str | bytes)
    return (
        isinstance(values, Sequence | np.ndarray)
        and not is_text
        and getattr(values, "ndim", 1) > 0
    )


def _listed(names: str | tuple[str, ...], values: Any) -> dict[str, NDArray[Any]]:
    """Return the arrays of one name, or of several names that vary together."""
    if isinstance(names, str):
        return {names: _sequence(names, values)}
    rows = [*values] if _are_several(values) else []
    return _columns(names, rows) if rows else {names[0]: _sequence(names, values)}


def _columns(names: tuple[str, ...], rows: Sequence[Any]) -> dict[str, NDArray[Any]]:
    """Return the arrays of names that vary together, from `rows` with one value for each name."""
    if any(not _are_several(row) or len(row) != len(names) for row in rows):
        raise SimulationError(
            f"{_quoted(names)} vary together: give {len(names)} values for each sample"
        )
    return {
        name: _sequence(name, [row[k] for row in rows]) for k, name in enumerate(names)
    }


def _sequence(names: str | tuple[str, ...], values: Any) -> NDArray[Any]:
    """Return a sequence of values as an array with samples along the first axis."""
    array = np.empty(0, dtype=object)
    if _are_several(values):
        with contextlib.suppress(ValueError):  # lists of different lengths
            array = np.asarray(values)
    if not array.size or array.dtype.kind not in "biufU":
        raise SimulationError(
            f"{_quoted(names)} cannot vary over {shown(values)}: give a sequence of values, or a frozen "
            "distribution such as scipy.stats.norm(1.0, 0.1)"
        )
    return array


def _draws(random: Vary, count: int, seed: int, method: str) -> dict[Any, NDArray[Any]]:
    """Return `count` samples of each distribution."""
    from scipy import stats

    if not random:
        return {}
    sizes = [int(getattr(d, "dim", 0)) for d in random.values()]
    places = spans(max(1, size) for size in sizes)
    # One point of all distributions together, so that Latin hypercubes and Sobol
    # points fill the whole space.
    numbers, found = _uniform(count, places[-1].stop, seed, method), {}
    each = zip(random.items(), sizes, places, strict=True)
    for (names, distribution), size, place in each:
        # SciPy's own families; others, such as histograms, are complete without parameters.
        family = getattr(distribution, "name", "")
        if family and getattr(stats, str(family), None) is distribution:
            raise SimulationError(
                f"the distribution of {_quoted(names)} has no parameters; give them, as in "
                f"stats.{family}(...)"
            )
        own = numbers[:, place]
        inverse = getattr(distribution, "icdf", getattr(distribution, "ppf", None))
        if not size and inverse is not None:
            found[names] = np.asarray(inverse(own[:, 0]))
        elif hasattr(distribution, "cov_object"):
            sizes_of, axes = np.linalg.eigh(
                distribution.cov_object.covariance
            )  # eigenvectors, as it may be singular
            # Round-off may make zero eigenvalues negative.
            spread = axes * np.sqrt(np.maximum(sizes_of, 0.0))
            found[names] = distribution.mean + stats.norm.ppf(own) @ spread.T
        elif method == "random":
            # Each distribution has its own stream of random numbers.
            generator = np.random.default_rng([seed, place.stop])
            found[names] = np.asarray(
                distribution.rvs(size=count, random_state=generator)
            ).reshape(count, -1)
        else:
            raise SimulationError(
                f"the distribution of {_quoted(names)} can be drawn by method='random' only"
            )
    return found


def _uniform(count: int, size: int, seed: int, method: str) -> Vector:
    """Return `count` points of `size` numbers between 0 and 1, both excluded."""
    from scipy.stats import qmc

    if method == "random":
        numbers = np.random.default_rng(seed).random((count, size))
    else:
        engine = getattr(qmc, ENGINES[method])
        numbers = engine(size, rng=np.random.default_rng(seed)).random(count)
    # The inverse of a distribution may be infinite at 0 and 1.
    return np.clip(numbers, 2.0**-54, 1 - 2.0**-53)
