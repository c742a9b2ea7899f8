"""Answers from the process of an FMU arrive exactly as they were sent, or are refused."""

import math
from contextlib import suppress

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from trussflow.fmu.runtime.ipc import AnswerError, decode, encode

plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20)
arrays = st.lists(st.floats(), max_size=5).map(np.array)
values = st.recursive(plain | st.binary(max_size=20) | arrays, lambda inner: st.lists(inner, max_size=4))


def same(one, other):
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and one.tobytes() == other.tobytes()
    both_nan = isinstance(one, float) and isinstance(other, float) and math.isnan(one) and math.isnan(other)
    return both_nan or (type(one) is type(other) and one == other)


@given(values)
def test_values_arrive_as_they_are(value):
    assert same(decode(encode(value)), value)


@given(values, st.data())
def test_damaged_values_are_refused_or_read(value, data):
    """Nothing but our own error, whatever bytes are changed, missing or too many."""
    content = bytearray(encode(value))
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content)))
        content[place : place + data.draw(st.integers(0, 2))] = data.draw(st.binary(max_size=3))
    with suppress(AnswerError):
        decode(bytes(content))
