"""Messages from the process of an FMU arrive exactly as they were sent, or are refused in time."""

import math
import os
import socket
import threading
import time
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trussflow.fmu.runtime.frames import MAX_BYTES, TOKEN_BYTES, FrameError, decode, encode, receive, send

plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20)
arrays = st.lists(st.floats(), max_size=5).map(np.array)
values = st.recursive(plain | st.binary(max_size=20) | arrays, lambda inner: st.lists(inner, max_size=4))


@pytest.fixture
def ends():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ours, theirs


def same(one, other):
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and one.tobytes() == other.tobytes()
    both_nan = isinstance(one, float) and isinstance(other, float) and math.isnan(one) and math.isnan(other)
    return both_nan or (type(one) is type(other) and one == other)


@given(values)
def test_values_arrive_as_they_are(value):
    assert same(decode(bytearray(encode(value))), value)


@given(values, st.data())
def test_damaged_values_are_refused_or_read(value, data):
    """Nothing but our own error, whatever bytes are changed, missing or too many."""
    content = bytearray(encode(value))
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content)))
        content[place : place + data.draw(st.integers(0, 2))] = data.draw(st.binary(max_size=3))
    with suppress(FrameError):
        decode(content)


@pytest.mark.parametrize(
    "frame",
    [
        b"\0" * 16,  # another token
        b"12345678" + (MAX_BYTES + 1).to_bytes(8, "little"),
        b"12345678" + bytes(8) + b"more",
    ],
)
def test_frames_that_are_none(ends, frame):
    ours, theirs = ends
    theirs.sendall(frame)
    with pytest.raises(FrameError):
        receive(ours, b"12345678", 5.0)


def test_a_frame_that_is_longer_than_what_comes_is_waited_for_in_vain(ends):
    """One byte after the other keeps nobody waiting: the time is for the whole frame."""
    ours, theirs = ends
    theirs.sendall(b"12345678" + MAX_BYTES.to_bytes(8, "little"))
    done = threading.Event()

    def drip():
        while not done.wait(0.01):
            theirs.sendall(b"x")

    thread = threading.Thread(target=drip)
    thread.start()
    begin = time.monotonic()
    with pytest.raises(TimeoutError):
        receive(ours, b"12345678", 0.3)
    done.set()
    thread.join()
    assert 0.3 <= time.monotonic() - begin < 5.0


def test_sending_ends_in_time_too(ends):
    with pytest.raises(TimeoutError):
        send(ends[0], bytes(TOKEN_BYTES), os.urandom(10_000_000), 0.2)


def test_a_closed_end(ends):
    ends[1].close()
    with pytest.raises(EOFError):
        receive(ends[0], bytes(TOKEN_BYTES), 5.0)
