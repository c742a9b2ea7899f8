"""Snapshots of runs, and their files: a line with the identity, and a line of JSON with the state.

Numbers of arrays are written in base64. Files are not pickles, as a file from an unknown source must not
be able to run code.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from fractions import Fraction
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.support.files import reading, replaced
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import as_path, shown


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Data that a run needs to continue from one time.

    Attributes
    ----------
    layout : str
        Identity of the diagram; snapshots of another identity are refused.
    now, origin : Fraction
        Time, and start time of the run [s].
    x, d, p : Vector
        Continuous states, discrete values, parameters [units as declared].
    hidden : dict
        Further data of Python blocks, keyed by path.
    sampled : bool
        Whether the sampled blocks due at this time have computed already.
    """

    layout: str
    now: Fraction
    origin: Fraction
    x: Vector
    d: Vector
    p: Vector
    hidden: Mapping[str, Any] = field(default_factory=dict)
    sampled: bool = False


def encode(state: Any, of: Mapping[str, Any]) -> bytes:
    """Return a state as bytes.

    Parameters
    ----------
    state : object
        Numbers, fractions, strings, bytes, arrays of numbers, snapshots; lists, tuples and dicts of such.
    of : mapping of str to str, number or list
        Identity of the saved object; others are refused.

    Raises
    ------
    TypeError
        If the state contains another object.
    """
    body = json.dumps(_plain(state)).encode("ascii")
    head = {"sha256": sha256(body).hexdigest(), "of": of}
    return json.dumps(head).encode("ascii") + b"\n" + body


def decode(data: bytes, of: Mapping[str, Any]) -> Any:
    """Return the state that `encode` wrote.

    Parameters
    ----------
    data : bytes
        Result of `encode`.
    of : mapping
        As for `encode`.

    Raises
    ------
    ValueError
        If the bytes are damaged, or have another identity.
    """
    head, _, body = bytes(data).partition(b"\n")
    try:
        content = json.loads(head)
        digest = content["sha256"]
        there = {**content["of"]}
    except (ValueError, KeyError, TypeError, RecursionError):
        raise ValueError(
            f"it is no saved state, or a part of one ({len(data)} bytes)"
        ) from None
    # Through JSON, as the identity in the file: tuples are lists.
    here = json.loads(json.dumps(of))
    if other := [
        name for name in {**here, **there} if there.get(name) != here.get(name)
    ]:
        more = f"; {len(other) - 3} more differ" if len(other) > 3 else ""
        told = (
            f"{name} is {shown(there.get(name))} there, {shown(here.get(name))} here"
            for name in other[:3]
        )
        raise ValueError(f"it is the state of something else: {'; '.join(told)}{more}")
    # After the identity, whose difference explains more to the user.
    if sha256(body).hexdigest() != digest:
        raise ValueError(f"it is damaged or cut off ({len(data)} bytes)")
    try:
        return _rebuilt(json.loads(body))
    except Exception as error:  # noqa: BLE001 - forged bytes may raise anything
        raise ValueError(f"it is damaged: {error}") from None


def write_state(path: str | Path, state: Any, of: Mapping[str, Any]) -> None:
    """Write a state to a file, atomically.

    Parameters
    ----------
    path : path
        The file.
    state, of
        As for `encode`.

    Raises
    ------
    SimulationError
        If the file, or an object in the state, cannot be written.
    """
    as_path(SimulationError, "cannot save to", path)
    try:
        content = encode(state, of)
        with replaced(path) as partial:
            partial.write_bytes(content)
    except (TypeError, OSError) as error:
        raise SimulationError(f"cannot save to '{path}': {error}") from error


def read_state(path: str | Path, of: Mapping[str, Any]) -> Any:
    """Return the state in a file that `write_state` wrote.

    Parameters
    ----------
    path : path
        The file.
    of : mapping
        As for `encode`.

    Raises
    ------
    SimulationError
        If it cannot be read, is damaged, or has another identity.
    """
    with reading(path, SimulationError, "cannot continue from") as file:
        return decode(file.read_bytes(), of)


def _plain(value: Any) -> Any:
    # First, as np.float64 is also a float: the type must survive.
    if isinstance(value, np.generic) and value.dtype.kind in "biufc":
        return {"scalar": _plain(np.asarray(value))["array"]}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, bytes):
        return {"bytes": base64.b64encode(value).decode("ascii")}
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        content = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode(
            "ascii"
        )
        return {"array": [value.dtype.str, list(value.shape), content]}
    if isinstance(value, Fraction):
        return {"fraction": [value.numerator, value.denominator]}
    if isinstance(value, list):
        return [_plain(v) for v in value]
    if isinstance(value, tuple):
        return {"tuple": [_plain(v) for v in value]}
    if isinstance(value, dict):
        # Pairs, as the keys of a JSON object are text only.
        return {"dict": [[_plain(k), _plain(v)] for k, v in value.items()]}
    if isinstance(value, Snapshot):
        hidden = []
        for path, kept in value.hidden.items():
            try:
                hidden.append([path, _plain(kept)])
            except TypeError as error:
                raise TypeError(f"block '{path}' keeps {error}") from None
        known = {
            f.name: _plain(getattr(value, f.name))
            for f in fields(value)
            if f.name != "hidden"
        }
        return {"snapshot": known | {"hidden": {"dict": hidden}}}
    raise TypeError(
        f"{shown(value)}, which cannot be written as bytes: a state consists of numbers, strings, "
        "bytes, arrays of numbers, and lists, tuples and dicts of such"
    )


def _rebuilt(value: Any) -> Any:
    if isinstance(value, list):
        return [_rebuilt(v) for v in value]
    if not isinstance(value, dict):
        return value
    # Every dictionary in a file has one key, its kind; anything else raises.
    ((kind, content),) = value.items()
    if kind == "bytes":
        return base64.b64decode(content, validate=True)
    if kind in ("array", "scalar"):
        dtype, shape, text = content
        raw = base64.b64decode(text, validate=True)
        # A copy, as frombuffer() returns a read-only array.
        array = np.frombuffer(raw, np.dtype(dtype)).reshape(shape).copy()
        return array if kind == "array" else array[()]
    if kind == "fraction":
        return Fraction(*content)
    if kind == "tuple":
        return tuple(_rebuilt(v) for v in content)
    if kind == "dict":
        return {_rebuilt(k): _rebuilt(v) for k, v in content}
    if kind == "snapshot":
        return Snapshot(**{name: _rebuilt(v) for name, v in content.items()})
    raise ValueError(f"unknown entry '{kind}'")
