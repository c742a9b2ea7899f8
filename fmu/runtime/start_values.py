"""Parameters and start values of an FMU: look up by name, check and set."""

from __future__ import annotations

import ctypes
import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import prod
from typing import Any

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.fmu.errors import FmuError
from trussflow.fmu.runtime.array_ports import gather
from trussflow.fmu.runtime.description import (
    MAX_ELEMENTS,
    NUMERIC_TYPES,
    REAL_TYPES,
    FmuDescription,
    FmuVariable,
)
from trussflow.fmu.runtime.library import Library
from trussflow.fmu.runtime.variable_buffers import VariableBuffers, shares

Starts = dict[str, Any]
"""Values by the FMU's variable names: flat vectors of floats, or lists of text."""


def settable(variable: FmuVariable) -> bool:
    """Return whether a variable may be set before initialization.

    Parameters
    ----------
    variable : FmuVariable
        The variable.
    """
    given = variable.causality in ("parameter", "structuralParameter", "input")
    stated = variable.initial in ("exact", "approx")
    return given or (stated and variable.variability != "constant")


def resolve(
    description: FmuDescription,
    given: Mapping[str, Any],
    aliases: Mapping[str, Sequence[FmuVariable]] | None = None,
) -> Starts:
    """Split given values into values of single variables, keyed by the FMU's names.

    Parameters
    ----------
    description : FmuDescription
        The model description.
    given : mapping of str to object
        Numbers [units as the FMU states] or text, by the name of a variable or array. The name of
        an array of scalar variables has no indices.
    aliases : mapping of str to sequence of FmuVariable, optional
        Variables by further names.

    Raises
    ------
    FmuError
        If a name is unknown or given twice, its variable cannot be set, or a value does not fit.
    """
    if not given:
        return {}
    allowed = [v for v in description.variables.values() if settable(v)]
    # If a name is ambiguous, the FMU's own name of a single variable has priority.
    meant: dict[str, Sequence[FmuVariable]] = {
        **(aliases or {}),
        **{group.name: group.variables for group in gather(allowed)},
        **{v.name: (v,) for v in allowed},
    }
    found: Starts = {}
    for name, value in given.items():
        if name not in meant:
            raise FmuError(_unknown(description, name, meant))
        for variable, part in _parts(description, name, meant[name], value):
            if variable.name in found:
                raise FmuError(
                    f"FMU '{description.name}': '{variable.name}' is given two values, the second by '{name}'"
                )
            found[variable.name] = part
    return found


def _unknown(description: FmuDescription, name: str, meant: Iterable[str]) -> str:
    if name in description.variables:
        variable = description.variables[name]
        return (
            f"FMU '{description.name}': '{name}' cannot be set; it is {variable.causality}, "
            f"{variable.variability}, and the FMU computes it"
        )
    close = difflib.get_close_matches(name, meant, n=4) or list(meant)[:8]
    return (
        f"FMU '{description.name}' has no variable '{name}' that can be set; some that can: "
        f"{', '.join(close) or 'none'}"
    )


def _parts(
    description: FmuDescription, name: str, variables: Sequence[FmuVariable], value: Any
) -> list[tuple[FmuVariable, Any]]:
    """Split a value among the variables of one name."""
    size = sum(v.size for v in variables)
    kind = variables[0].type  # that of all elements of an array
    where = f"FMU '{description.name}': '{name}'"
    if kind == "String":
        texts = list(value) if isinstance(value, list | tuple) else [value]
        if len(texts) != size or not all(isinstance(text, str) for text in texts):
            raise FmuError(f"{where} takes {size} text(s), not {value!r}")
        return shares(variables, texts)
    if kind not in NUMERIC_TYPES:
        raise FmuError(f"{where} is of type {kind}, which cannot be set from here")
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise FmuError(f"{where} must be a number, not {value!r}") from None
    if numbers.ndim == 0:
        numbers = np.full(size, float(numbers))
    if numbers.size != size:
        raise FmuError(f"{where} has {size} elements, not {numbers.size}")
    if not np.isfinite(numbers).all():
        raise FmuError(f"{where} must be finite, not {value!r}")
    if kind not in REAL_TYPES and not (numbers == np.rint(numbers)).all():
        raise FmuError(
            f"{where} is of type {kind}; it takes whole numbers, not {value!r}"
        )
    if any(
        isinstance(v, int) and v != float(v)
        for v in np.asarray(value, dtype=object).flat
    ):
        raise FmuError(
            f"{where} cannot be {value!r}: numbers are passed as floats, which are exact for integers up to 2^53"
        )
    return shares(variables, np.ravel(numbers))


def declared_start(variable: FmuVariable) -> Vector:
    """Return the flat start value in the model description, or zero if it states none.

    Parameters
    ----------
    variable : FmuVariable
        A numeric variable.

    Raises
    ------
    FmuError
        If the text is not numeric, or its number of values differs from that of the variable.
    """
    if variable.start is None:
        return np.zeros(variable.size)
    words = {"true": "1", "false": "0"}
    try:
        values = [float(words.get(w, w)) for w in variable.start.split()]
        # One start value holds for all elements; the copy can be written to.
        return np.array(np.broadcast_to(values, variable.size))
    except ValueError:
        raise FmuError(
            f"start value '{variable.start}' of variable '{variable.name}' does not fit: it must "
            f"be {variable.size} number(s)"
        ) from None


def apply(library: Library, starts: Mapping[str, Any]) -> None:
    """Set start values in a new instance.

    Parameters
    ----------
    library : Library
        Library of the instance.
    starts : mapping of str to object
        Result of `resolve`.
    """
    known = library.description.variables
    numbers = []
    for name, value in starts.items():
        if known[name].type != "String":
            numbers.append(known[name])
            continue
        listed = (ctypes.c_char_p * len(value))(*(text.encode() for text in value))
        library.accessor(False, "String", [known[name].reference], listed, len(value))()
    bank = VariableBuffers(numbers, library, writes=True)
    for variable, part in shares(numbers, bank.values):
        part[:] = starts[variable.name]
    bank.bind()
    bank.write()


def resized(description: FmuDescription, given: Mapping[str, Any]) -> FmuDescription:
    """Return a description with the array sizes that the structural parameters set.

    Parameters
    ----------
    description : FmuDescription
        The model description.
    given : mapping of str to object
        Values by name; only structural parameters are used.

    Raises
    ------
    FmuError
        If a value does not fit, or a size is too large.
    """
    known = description.variables
    structure = {
        name: value
        for name, value in given.items()
        if name in known and known[name].is_structural
    }
    sizes: dict[int | None, int] = {}
    for name, values in resolve(description, structure).items():
        size = float(values[0])
        if not 0 <= size <= MAX_ELEMENTS:
            raise FmuError(
                f"FMU '{description.name}': '{name}' sets array sizes; it must be from 0 "
                f"to {MAX_ELEMENTS}, not {size:g}"
            )
        sizes[known[name].reference] = int(size)
    if not sizes:
        return description

    def fit(v: FmuVariable) -> FmuVariable:
        pairs = zip(v.dimensions, v.shape, strict=True)
        shape = tuple(sizes.get(reference, size) for reference, size in pairs)
        if shape == v.shape:
            return v
        # Declared values of another size have no meaning after the change.
        fits = len((v.start or "").split()) in (1, prod(shape))
        return replace(v, shape=shape, start=v.start if fits else None)

    variables = {name: fit(variable) for name, variable in known.items()}
    return replace(
        description,
        variables=variables,
        states=tuple(variables[v.name] for v in description.states),
        derivatives=tuple(variables[v.name] for v in description.derivatives),
    )
