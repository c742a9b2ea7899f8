"""Compact encoding of arrays in a page, which is decoded without any library."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.support.types import Vector


class Packer:
    """Packer of arrays into one blob of bytes.

    The blob has the first bytes of all numbers of an array, then the second bytes, and so on. Neighbours in
    time differ in their last bytes only, so that the compressed size is about half.
    """

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def pack(
        self, values: npt.ArrayLike, *, width: int = 4, bits: int = 52
    ) -> dict[str, Any]:
        """Add an array, and return its position in the blob.

        Parameters
        ----------
        values : array_like, shape (rows, columns)
            Array to add [any].
        width : int
            Bytes per number, 4 or 8 [-].
        bits : int
            Number of kept mantissa bits, of 23 or 52; few bits compress better [-].
        """
        with np.errstate(over="ignore"):  # a chart cannot show numbers beyond float32
            array = np.ascontiguousarray(values, dtype=f"<f{width}")
        dropped = (23 if width == 4 else 52) - bits
        if dropped > 0:
            whole = array.view(f"<u{width}")
            half, kept = 1 << (dropped - 1), -1 << dropped
            array = (
                (whole + whole.dtype.type(half)) & np.array(kept).astype(whole.dtype)
            ).view(array.dtype)
        raw = np.ascontiguousarray(array.reshape(-1, 1).view(np.uint8).T).tobytes()
        found = {"offset": self._size, "shape": list(array.shape), "width": width}
        self._parts.append(raw)
        self._size += len(raw)
        return found

    def blob(self) -> str:
        """Return all arrays, compressed, as text for the zlib decoder of the page."""
        packed = zlib.compress(b"".join(self._parts))
        return base64.b64encode(packed).decode("ascii")


def columns(values: npt.ArrayLike) -> Vector:
    """Return values over time as rows of components, one column per instant.

    Parameters
    ----------
    values : array_like, shape (instants, ...)
        Values over time [any].
    """
    array = np.asarray(values, dtype=float)
    return array.reshape(len(array), -1).T
