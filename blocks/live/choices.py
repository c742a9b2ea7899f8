"""Choices for a live page: parameters with sliders, charted signals, and the step."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import product
from math import ceil, floor, log10
from typing import Any

import numpy as np

from trussflow.blocks.errors import NameLookupError, SimulationError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import common_tick
from trussflow.blocks.framework.declarations import Parameter, State
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.framework.units import readable
from trussflow.blocks.linear_analysis.references import element_labels, split_index
from trussflow.blocks.results.channels import Channel
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import finite_array
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import derivative

MAX_CONTROLS = 12
"""Sliders of a page whose parameters are not chosen [-]."""

MAX_CONTROL_SIZE = 3
"""Size of an array of which each element gets a slider without being chosen [-]."""

MAX_CONTROL_VALUE = 1e100
"""Size of a number above which it means "no limit" [unit]."""

MAX_DEFAULT_CURVES = 48
"""Curves of a page whose signals are not chosen [-]."""

RANGE_FACTOR = 4.0
"""Ratio of the end of a slider to the value in its middle [-]."""

STEPS_PER_RADIAN = 20.0
"""Steps per time constant of the fastest mode [-]."""

MIN_STEPS = 1000
"""Least number of steps in a run whose step is not given [-]."""

GAIN_NAMES = re.compile("gain|^k[pid]?$|stiffness|damping|bandwidth")
"""Names of parameters that come first."""

Ends = tuple[float, float]


def controls(
    plan: Plan, p: Vector, chosen: Mapping[str, Ends | None] | Sequence[str] | None
) -> list[dict[str, Any]]:
    """Return the sliders of a page.

    Parameters
    ----------
    plan : Plan
        The plan.
    p : Vector
        Values of all parameters [as declared].
    chosen : mapping, sequence or None
        References such as ``"pid.kp"`` or ``"law.gain[0]"``, optionally with the ends of the slider; None for
        the usual ones.

    Returns
    -------
    list of dict
        For each slider its name, index in p, ends, unit, meaning and limits.

    Raises
    ------
    NameLookupError
        If there is no such parameter.
    SimulationError
        If the ends of a slider do not enclose the value, or Python code computes an initial state from it.
    """
    if isinstance(chosen, str):
        chosen = [chosen]
    ranges: Mapping[str, Ends | None] = (
        chosen
        if isinstance(chosen, Mapping)
        else dict.fromkeys(_usual(plan, p) if chosen is None else chosen)
    )
    found = []
    for reference, ends in ranges.items():
        name, index = split_index(reference)
        entry = plan.p.find(name, "parameter", hint=plan.structural(name))
        declared: Parameter = plan.system.blocks[entry.path]._declared[entry.name]
        numbers = np.arange(entry.start, entry.stop).reshape(entry.shape)
        labels = element_labels(name, entry.shape)
        try:
            places = np.ravel(numbers if index is None else numbers[index])
        except IndexError as error:
            raise NameLookupError(f"parameter '{reference}': {error}") from None
        for place in places.tolist():
            control = {
                "name": labels[place - entry.start],
                "array": name,
                "place": place,
                "unit": readable(declared.unit),
                "meaning": declared.meaning,
                **_range(reference, float(p[place]), declared.bounds, ends),
            }
            other = control["low" if p[place] == control["high"] else "high"]
            if not _starts_in_python(plan, p, entry.path, place, other):
                found.append(control)
            elif chosen is not None:
                raise SimulationError(
                    f"'{control['name']}' cannot have a slider: initial() of block '{entry.path}' "
                    "computes a state from it in Python; choose other parameters"
                )
    return found


def _usual(plan: Plan, p: Vector) -> list[str]:
    """Return references to the parameters of blocks in the outermost diagram, gains first."""
    inside = [
        e
        for e in plan.p
        if e.stop - e.start <= MAX_CONTROL_SIZE
        and (abs(p[e.start : e.stop]) < MAX_CONTROL_VALUE).all()
    ]
    top = [e for e in inside if "." not in e.path] or inside
    found, size = [], 0
    for e in sorted(top, key=lambda e: not GAIN_NAMES.search(e.name)):
        size += e.stop - e.start
        if size <= MAX_CONTROLS and e.stop > e.start:
            found.append(f"{e.path}.{e.name}")
    return found


def _starts_in_python(
    plan: Plan, p: Vector, path: str, place: int, value: float
) -> bool:
    """Return whether a block computes initial states in Python from the number at a `place` in p."""
    block, changed = plan.system.blocks[path], p.copy()
    changed[place] = value
    before, after = (plan.p.signals(path, values) for values in (p, changed))
    return type(block).initial is not Block.initial and any(
        not np.array_equal(block.initial(name, before), block.initial(name, after))
        for name in block.declared(State)
    )


def _range(
    name: str, value: float, bounds: Mapping[str, float], ends: Ends | None
) -> dict[str, Any]:
    """Return the limits and ends of a slider, and whether its scale is logarithmic."""
    # The neighbour of a limit that is not allowed itself; finite, as JSON has no infinity.
    least, most = (
        bounds.get(reached, float(np.nextafter(bounds.get(excluded, far), -far)))
        for reached, excluded, far in (
            ("at least", "above", -np.inf),
            ("at most", "below", np.inf),
        )
    )
    is_finite = abs(value) < MAX_CONTROL_VALUE
    if ends is not None:
        low, high = finite_array(f"the range of '{name}'", ends, (2,)).tolist()
        if (is_finite and not low <= value <= high) or low == high:
            raise SimulationError(
                f"the range {low:g} to {high:g} of parameter '{name}' must contain its value {value:g}"
            )
    elif not is_finite:
        raise SimulationError(
            f"parameter '{name}' is infinite; give the ends of its slider: parameters={{'{name}': (low, high)}}"
        )
    elif most - least < MAX_CONTROL_VALUE:
        low, high = least, most
    else:
        low, high = sorted((value / RANGE_FACTOR, value * RANGE_FACTOR))
        low, high = max(low or -1.0, least), min(high or 1.0, most)
    return {"low": low, "high": high, "log": low > 0.0, "min": least, "max": most}


def usual_signals(system: System) -> dict[str, Port]:
    """Return the signals of a page by name: exposed outputs, otherwise those of all blocks."""
    outputs = [port for block in system.blocks.values() for port in block.outputs()]
    found, size = dict[str, Port](), 0
    for port in system.root.outputs() or outputs:
        size += port.size
        if not found or size <= MAX_DEFAULT_CURVES:
            found[port.name if port.block is system.root else port.path] = port
    return found


def charts(channels: Sequence[Channel]) -> list[dict[str, Any]]:
    """Return the charts of logged channels: scalars of one unit share one, an array has its own.

    Parameters
    ----------
    channels : sequence of Channel
        The channels.
    """
    shared: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for channel in channels:
        units, columns = channel.port.element_units(), channel.places.tolist()
        own = channel.name if len(columns) > 1 else ""
        for label, column, unit in zip(_labels(channel), columns, units, strict=True):
            # The title of a chart of an array has its name.
            curve = {"label": label.removeprefix(own).strip(), "column": column}
            shared.setdefault((own, readable(unit or "")), []).append(curve)
    return [
        {
            "title": own or ", ".join(curve["label"] for curve in curves),
            "unit": unit,
            "scalar": not own,
            "curves": curves,
        }
        for (own, unit), curves in shared.items()
    ]


def _labels(channel: Channel) -> list[str]:
    """Return the names of the elements of a channel, by the labels of its axes if there are any."""
    sizes = zip(channel.axes.values(), channel.port.shape or (), strict=True)
    each = product(*(map(str, labels or range(size)) for labels, size in sizes))
    return [f"{channel.name}[{', '.join(e)}]" if e else channel.name for e in each]


def usual_step(
    plan: Plan, duration: Fraction, x: Vector, d: Vector, p: Vector
) -> Fraction:
    """Return a step from the fastest mode at the initial state, or a part of the sample time [s].

    Parameters
    ----------
    plan : Plan
        The plan.
    duration : Fraction
        Duration of the run [s].
    x, d, p : Vector
        Initial values [as declared].
    """
    (rate,) = plan.trace([derivative()])
    matrix = rate.jacobian(1)(0.0, x, d, p).full()
    rates = np.linalg.eigvals(matrix) if np.isfinite(matrix).all() else np.zeros(0)
    fastest = np.abs(rates).max(initial=1e-300)
    limit = min(duration / MIN_STEPS, Fraction(1.0 / (STEPS_PER_RADIAN * fastest)))
    if clocks := plan.system.clocks:
        tick = common_tick([t for c in clocks for t in (c.period, c.offset)])
        return tick / max(1, ceil(tick / limit))
    power = Fraction(10) ** floor(log10(limit))
    return max(n * power for n in (1, 2, 5) if n * power <= limit)
