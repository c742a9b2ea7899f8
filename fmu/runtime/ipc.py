"""Answers of the process of an FMU as bytes: JSON, which cannot run code when it is read.

The process of an FMU is not trusted, so its answers are not pickled.
"""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

MAX_BYTES = 1_000_000_000
"""Maximum size of an answer [B]; the largest answers are saved states."""

_ARRAY_TYPES = {"float64": np.float64, "bool": np.bool_}


class AnswerError(Exception):
    """The received bytes are not an encoded value."""


def encode(value: Any) -> bytes:
    """Return a value as bytes: numbers, Booleans, text, bytes, vectors, None, and sequences of these.

    Parameters
    ----------
    value : object
        The value; sequences become lists.
    """
    return json.dumps(value, default=_raw).encode()


def _raw(item: Any) -> dict[str, str]:
    kind = "bytes" if isinstance(item, bytes) else item.dtype.name
    return {kind: base64.b64encode(item).decode()}


def decode(content: bytes) -> Any:
    """Return the value that `encode` wrote.

    Parameters
    ----------
    content : bytes
        Bytes from `encode`.

    Raises
    ------
    AnswerError
        If the bytes are not an encoded value.
    """
    try:
        return json.loads(content, object_hook=_restored)
    except Exception as error:
        raise AnswerError from error


def _restored(item: dict[str, str]) -> Any:
    ((kind, text),) = item.items()
    raw = base64.b64decode(text)
    return raw if kind == "bytes" else np.frombuffer(raw, _ARRAY_TYPES[kind]).copy()
