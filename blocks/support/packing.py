"""Arrays in the data of pages."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.support.types import Vector


def packed(values: npt.ArrayLike, bits: int = 53) -> dict[str, Any]:
    """Return an array as JSON, which `unpacked` of ``chart.js`` reads.

    The text has the first bytes of all numbers, then the second bytes, and so on, without bytes that are zero.
    Neighbours in time differ in few bytes, so that the compressed size is about half.

    Parameters
    ----------
    values : array_like
        Array of one or two axes [any].
    bits : int
        Number of kept bits of the mantissa, of 53; few bits compress better [-].
    """
    mantissas, exponents = np.frexp(np.asarray(values, dtype=float))
    kept: Vector = np.ldexp(np.round(np.ldexp(mantissas, bits)), exponents - bits)
    planes = kept.astype("<f8").reshape(-1, 1).view(np.uint8).T[(53 - bits) // 8 :]
    text = base64.b64encode(planes.tobytes()).decode()
    return {"shape": kept.shape, "packed": text}


def compressed(content: bytes) -> str:
    """Return `content` as text, which `inflated` of ``chart.js`` reads."""
    return base64.b64encode(zlib.compress(content)).decode()


def spread(size: int, most: float) -> Vector:
    """Return indices of at `most` so many of `size` instants, first and last included [-]."""
    count = max(2, min(size, int(most)))
    return np.linspace(0, size - 1, count).round().astype(int)
