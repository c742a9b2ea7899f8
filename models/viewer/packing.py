"""Arrays as bytes that a page can carry: small, and read back without any library."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.telling import all_counted
from trussflow.blocks.framework.types import Vector

PART = 1_000_000
"""Of what is compressed, between two looks at the clock [byte]."""


class Packer:
    """Collects arrays into one blob of bytes.

    In the blob the first bytes of all numbers of an array come first, then the second ones, and so on:
    neighbours in time differ in their last bytes only, so this compresses to about half.
    """

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def pack(self, values: npt.ArrayLike, *, width: int = 4, bits: int = 52) -> dict[str, Any]:
        """Add an array, and return what the page needs to find it.

        Parameters
        ----------
        values : array_like, shape (rows, columns)
            What to carry [any].
        width : int
            Bytes of a number, 4 or 8 [-].
        bits : int
            Bits kept of the 23 or 52 after the point; few of them compress far better [-].
        """
        with np.errstate(over="ignore"):  # what is beyond a float32 is beyond a chart
            array = np.ascontiguousarray(values, dtype=f"<f{width}")
        dropped = (23 if width == 4 else 52) - bits
        if dropped > 0:
            whole = array.view(f"<u{width}")
            half, kept = 1 << (dropped - 1), -1 << dropped
            array = ((whole + whole.dtype.type(half)) & np.array(kept).astype(whole.dtype)).view(array.dtype)
        raw = np.ascontiguousarray(array.reshape(-1, 1).view(np.uint8).T).tobytes()
        found = {"offset": self._size, "shape": list(array.shape), "width": width}
        self._parts.append(raw)
        self._size += len(raw)
        return found

    def blob(self) -> str:
        """Return all arrays, compressed, as text."""
        return compressed(b"".join(self._parts))


def compressed(raw: bytes) -> str:
    """Return bytes as text that the page's own zlib reads.

    Parameters
    ----------
    raw : bytes
        Any.
    """
    whole, packer = memoryview(raw), zlib.compressobj()
    parts = [whole[start : start + PART] for start in range(0, len(raw), PART)]
    packed = all_counted("compressing", packer.compress, parts)
    return base64.b64encode(b"".join([*packed, packer.flush()])).decode("ascii")


def columns(values: npt.ArrayLike) -> Vector:
    """Return values over time as rows of components, one column per instant.

    Parameters
    ----------
    values : array_like, shape (instants, ...)
        [any].
    """
    array = np.asarray(values, dtype=float)
    return array.reshape(len(array), -1).T
