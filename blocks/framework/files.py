"""Files written in one piece: readers see the old one or the new one, never a half."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4


@contextlib.contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """Yield a path beside the one wanted, to write to; at the end it takes the other's place.

    If the body raises, what was written is deleted, and an old file stays as it is.

    Parameters
    ----------
    path : str or pathlib.Path
        The file wanted; its folder must be there.

    Raises
    ------
    OSError
        If the file cannot be put into its place.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.{uuid4().hex[:12]}.partial")  # two may write at once
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
