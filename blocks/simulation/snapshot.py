"""Snapshots: everything a run needs to go on from one time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from trussflow.blocks.framework.types import Vector


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything a run needs to go on from one time.

    Attributes
    ----------
    layout : str
        Identity of the diagram; snapshots of another identity are refused.
    now, origin : Fraction
        Time, and time at which the run began [s].
    x, d, p : Vector
        Continuous states, what changes at instants, parameters [units as declared].
    hidden : dict
        Further data of Python blocks, keyed by path.
    sampled : bool
        Whether what is sampled at this time has computed already.
    """

    layout: str
    now: Fraction
    origin: Fraction
    x: Vector
    d: Vector
    p: Vector
    hidden: Mapping[str, Any] = field(default_factory=dict)
    sampled: bool = False
