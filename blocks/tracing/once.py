"""What several equations of a block need is computed once, where they are asked one after the other."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import wraps
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.tracing import active_trace, is_traced

Result = TypeVar("Result")


def once(method: Callable[..., Result]) -> Callable[..., Result]:
    """Let a method of a block return its latest result again while its arguments are the same.

    Numbers are compared, so arrays may be written into in between, and in results too; expressions are the
    same if they are the same objects, within one trace.

    Parameters
    ----------
    method : callable
        Takes the block and `Signals`, and depends on nothing else that changes.
    """
    latest = WeakKeyDictionary[Block, tuple[list[object], object, Result]]()

    @wraps(method)
    def call(block: Block, *signals: Signals) -> Result:
        trace = active_trace()
        given = [((k, name), value) for k, each in enumerate(signals) for name, value in each.items()]
        traced = any(is_traced(value) for _, value in given)
        asked: list[object] = [id(trace), *((place, _told(value)) for place, value in given)]
        found = latest.get(block)
        if found is None or found[0] != asked:
            # What is told by its identity is kept, so that nothing else gets the same.
            found = latest[block] = asked, (trace, given), method(block, *signals)
        return found[2] if traced else deepcopy(found[2])

    return call


def _told(value: Array) -> object:
    """Return what tells an array from all others."""
    if is_traced(value):
        return id(value)
    array = np.asarray(value)
    return array.dtype, array.shape, array.tobytes()
