"""Metrics of runs, each defined once: the largest norm or component, over the run, late in it, at its end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.support.types import Vector

LATE_WINDOW = 10.0
"""Length of the late part of a run, at its end [s]."""

DEFINITIONS = """\
In the tables *(norm)* is the largest Euclidean norm of a vector over time, *(component)* the largest absolute
value over time of any of its axes, angles or joints."""
"""Explanation of the column heads, for reports."""


def largest_component(values: npt.ArrayLike) -> float:
    """Return the largest absolute value, 0 if there are none.

    Parameters
    ----------
    values : array_like
        Any number of components at any number of instants [any].
    """
    return float(np.max(np.abs(np.asarray(values)), initial=0.0))


def largest_norm(vectors: npt.ArrayLike) -> float:
    """Return the largest Euclidean norm, 0 if there are none.

    Parameters
    ----------
    vectors : array_like, shape (..., n)
        Vectors along the last axis [any].
    """
    return float(np.max(np.linalg.norm(np.asarray(vectors), axis=-1), initial=0.0))


def late_part(time: Vector, window: float = LATE_WINDOW) -> npt.NDArray[np.bool_]:
    """Return which instants are late.

    Parameters
    ----------
    time : Vector, shape (n,)
        Logged instants [s].
    window : float
        Length of the late part; the instant at its start is late, too [s].
    """
    late: npt.NDArray[np.bool_] = time >= time[-1] - window
    return late


def tracking_metrics(
    time: Vector, errors: Mapping[str, Vector], *, late: float = LATE_WINDOW
) -> dict[str, float]:
    """Return the metrics of tracking errors.

    Parameters
    ----------
    time : Vector, shape (n,)
        Logged instants [s].
    errors : mapping of str to Vector, shape (n, ...)
        By name, vectors along the last axis [any].
    late : float
        Length of the late part [s].

    Returns
    -------
    dict
        Of each error the ``peak`` over the run, the ``late`` and the ``final`` one, each as norm and as
        component: ``"late position (norm)"`` [as the error].
    """
    late_rows = late_part(time, late)
    parts: dict[str, Any] = {
        "peak": slice(None),
        "late": late_rows,
        "final": slice(-1, None),
    }
    kinds = {"norm": largest_norm, "component": largest_component}
    return {
        f"{part} {name} ({kind})": largest(error[rows])
        for name, error in errors.items()
        for part, rows in parts.items()
        for kind, largest in kinds.items()
    }
