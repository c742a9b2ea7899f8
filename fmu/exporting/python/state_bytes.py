"""States of an FMU as bytes: JSON with the numbers of arrays in base64, never a pickle.

Bytes may come from anywhere, so reading them must not be able to run code.
"""

from __future__ import annotations

import base64
import json
from fractions import Fraction
from typing import Any

import numpy as np

VERSION = 1
"""Changes whenever what `encode` writes does."""


def encode(state: Any, token: str) -> bytes:
    """Return a state as bytes.

    Parameters
    ----------
    state : object
        Numbers, fractions, strings, bytes, NumPy arrays of numbers; lists, tuples and dicts of such.
    token : str
        What tells apart FMUs that cannot exchange states.

    Raises
    ------
    TypeError
        If there is anything else in it.
    """
    return json.dumps({"version": VERSION, "token": token, "state": _plain(state)}).encode("ascii")


def decode(data: bytes, token: str) -> Any:
    """Return the state that `encode` wrote.

    Parameters
    ----------
    data : bytes
        What `encode` returned.
    token : str
        As for `encode`.

    Raises
    ------
    ValueError
        If the bytes are damaged, or of another FMU.
    """
    try:
        content = json.loads(data)
        version, maker, state = content["version"], content["token"], content["state"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"these {len(data)} bytes are no state of this FMU: {error}") from None
    if (version, maker) != (VERSION, token):
        raise ValueError("these bytes are the state of another FMU, or of another version of it")
    try:
        return _rebuilt(state)
    except (ValueError, KeyError, TypeError, IndexError, ZeroDivisionError) as error:
        raise ValueError(f"these bytes are a damaged state of this FMU: {error}") from None


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, bytes):
        return {"bytes": base64.b64encode(value).decode("ascii")}
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        content = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode("ascii")
        return {"array": [value.dtype.str, list(value.shape), content]}
    if isinstance(value, Fraction):
        return {"fraction": [value.numerator, value.denominator]}
    if isinstance(value, list):
        return [_plain(v) for v in value]
    if isinstance(value, tuple):
        return {"tuple": [_plain(v) for v in value]}
    if isinstance(value, dict):
        return {"dict": [[_plain(k), _plain(v)] for k, v in value.items()]}
    raise TypeError(
        f"{type(value).__name__} cannot be written as bytes: a state consists of numbers, strings, "
        "bytes, arrays of numbers, and lists, tuples and dicts of such"
    )


def _rebuilt(value: Any) -> Any:
    if isinstance(value, list):
        return [_rebuilt(v) for v in value]
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    if kind == "bytes":
        return base64.b64decode(content, validate=True)
    if kind == "array":
        dtype, shape, text = content
        raw = base64.b64decode(text, validate=True)
        return np.frombuffer(raw, np.dtype(dtype)).reshape(shape).copy()
    if kind == "fraction":
        return Fraction(*content)
    if kind == "tuple":
        return tuple(_rebuilt(v) for v in content)
    if kind == "dict":
        return {_rebuilt(k): _rebuilt(v) for k, v in content}
    raise ValueError(f"unknown entry '{kind}'")
