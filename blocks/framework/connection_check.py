"""Connection check: shape, unit and frame of two ports, and their inference."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trussflow.blocks.errors import WiringError
from trussflow.blocks.framework.port import INFERRED, Port
from trussflow.blocks.framework.units import Unit, mismatch


def same(first: Port | None, second: Port | None) -> bool:
    """Return whether `first` and `second` are the same slice of one port, or both None."""
    if (
        first is None
        or second is None
        or first.block is not second.block
        or first.name != second.name
    ):
        return first is second
    if first.index is None or second.index is None:
        return first.index is second.index
    # By elements: port[0:2] and port[[0, 1]] are the same slice.
    return np.array_equal(first.elements(), second.elements())


def overlap(first: Port, second: Port) -> bool:
    """Return whether the ports `first` and `second` have elements in common."""
    if first.block is not second.block or first.name != second.name:
        return False
    whole = first.index is None or second.index is None
    return whole or bool(np.intersect1d(first.elements(), second.elements()).size)


def fit(
    source: Port, target: Port, where: str, candidates: Iterable[Port] = ()
) -> None:
    """Check that two ports fit, and infer open properties of one from the other.

    Parameters
    ----------
    source, target : Port
        Output and input, whole or sliced.
    where : str
        ``file:line`` of the wire.
    candidates : iterable of Port
        Outputs to search for a better match when these two do not fit.

    Raises
    ------
    WiringError
        If direction, shape, unit or frame do not fit. The message names both ports.
    """
    if source.is_input or not target.is_input:
        kinds = [
            "an input" if port.is_input else "an output" for port in (source, target)
        ]
        fault = f"{kinds[0]} cannot drive {kinds[1]}; an output drives an input"
        raise WiringError(_message(source, target, [fault], where))
    try:
        faults = _faults(source, target)
        if not faults:
            # Inference may reveal what could not be compared before, such
            # as units per element.
            _infer(source, target, where)
            faults = _faults(source, target)
    except WiringError as error:  # the numbers of units and elements differ
        raise WiringError(_message(source, target, [str(error)], where)) from error
    if faults:
        better = [c.describe() for c in candidates if _would_fit(c, target)]
        if better:
            faults.append(
                f"outputs that fit {target.describe()}: {', '.join(better[:3])}"
            )
        raise WiringError(_message(source, target, faults, where))


def _would_fit(source: Port, target: Port) -> bool:
    """Return whether an output is a candidate for an input."""
    # An output of open shape would fit every input, so it is no useful proposal.
    if source.block is target.block or source.inferable_shape.is_open:
        return False
    try:
        return not _faults(source, target)
    except WiringError:
        return False


def unite(first: Port, second: Port, where: str) -> None:
    """Check that one wire, made at `where`, can drive both inputs, `first` and `second`.

    After the check, the inputs share their inferred properties.

    Raises
    ------
    WiringError
        If shape, unit or frame do not fit.
    """
    if faults := _faults(first, second):
        head = f"cannot group {first.describe()} and {second.describe()}   [{where}]"
        raise WiringError("\n  ".join([head, *faults]))
    _infer(first, second, where)


def _infer(source: Port, target: Port, where: str) -> None:
    """Infer shape, unit, frame and labels of one port from the other."""
    if source.index is None and target.index is None:
        for name in (
            "inferable_shape",
            "inferable_unit",
            "inferable_frame",
            "inferable_labels",
        ):
            getattr(source, name).unify(getattr(target, name), where)
        return
    # A slice cannot share the properties of a whole port: its values
    # are copied instead.
    for known, other in ((source, target), (target, source)):
        shape = other.inferable_shape
        if other.index is None and shape.is_open and known.shape is not None:
            shape.fix(known.shape, where)
    # A wire to a part of an input says nothing about the unit and
    # labels of the other parts.
    if target.index is not None:
        return
    if source.index is not None and target.inferable_unit.is_open:
        units = source.element_units()
        target.inferable_unit.fix(units[0] if len(set(units)) == 1 else units, where)
    if target.inferable_labels.is_open and (axes := source.axes()):
        target.inferable_labels.fix(axes, where)


def _faults(source: Port, target: Port) -> list[str]:
    """Return the list of all properties that do not fit."""
    faults = []
    shapes, units = (source.shape, target.shape), (source.unit, target.unit)
    pairs: Iterable[tuple[Unit, Unit]] = [units]
    # With one unit for all elements, the number of the element says nothing.
    by_element = any(isinstance(unit, tuple) for unit in units)
    # While a shape is open, only the units of the whole ports can be compared.
    if None not in shapes:
        if shapes[0] != shapes[1]:
            pairs = []
            fault = f"shape {shapes[0]} does not fit {shapes[1]}"
            faults.append(fault + _origins(source, target, "shape"))
        elif by_element:
            pairs = zip(source.element_units(), target.element_units(), strict=True)
    for i, (a, b) in enumerate(pairs):
        if isinstance(a, str) and isinstance(b, str) and (why := mismatch(a, b)):
            fault = f"{why} (element {i})" if by_element else why
            faults.append(fault + _origins(source, target, "unit"))
            # One fault is enough: with a wrong unit, often all elements are wrong.
            break
    frames = source.frame, target.frame
    if None not in frames and frames[0] != frames[1]:
        fault = f"frame {frames[0]!r} does not fit {frames[1]!r}; rotate the vector"
        faults.append(fault + _origins(source, target, "frame"))
    return faults


def _origins(source: Port, target: Port, what: str) -> str:
    """Return the lines that fixed the inferred shape, unit or frame of the ports."""
    found = [
        (port.path, getattr(port, f"inferable_{what}").origin())
        for port in (source, target)
        if getattr(port.declaration, what) is INFERRED
    ]
    return "".join(
        f"\n    {path} has its {what} from {line}" for path, line in found if line
    )


def _message(source: Port, target: Port, faults: list[str], where: str) -> str:
    head = f"cannot wire {source.describe()} >> {target.describe()}   [{where}]"
    return "\n  ".join([head, *faults])
