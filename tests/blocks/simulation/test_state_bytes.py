"""States as bytes: everything comes back equal to the bit, and nothing else is accepted."""

import math
from fractions import Fraction
from hashlib import sha256

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trussflow.blocks.results.state_file import decode, encode

OF = {"FMU": "an FMU", "step": 0.1}
NUMBERS = np.random.default_rng(0).standard_normal((2, 3)) * 10.0 ** np.arange(
    -300, 300, 200
)
VALUES = (
    None,
    True,
    0,
    -(2**70),
    Fraction(-1, 3),
    0.1,
    5e-324,
    "",
    'a "quoted" \u03b8',
    b"",
    b"\x00\xff",
    NUMBERS,
    NUMBERS.T,
    NUMBERS + 1j,
    np.zeros((0, 3)),
    np.array(7, dtype=np.int8),
    np.array([True, False]),
    np.float32(0.1),
    np.float64(0.1),
    np.int32(-7),
    np.bool_(True),
    np.complex64(1 - 2j),
    {np.int32(1): [np.uint8(255)]},
    [math.nan, math.inf, -0.0],
    [],
    (),
    {},
    [(1, [2.5]), {"x": NUMBERS, 3: (b"y",)}],
)


@pytest.mark.parametrize("value", VALUES, ids=str)
def test_what_is_written_is_read_again(value):
    with np.printoptions(floatmode="unique", legacy=False):
        assert repr(decode(encode(value, OF), OF)) == repr(value)


def test_read_arrays_can_be_changed():
    array = decode(encode(np.ones(3), OF), OF)
    array[0] = 2.0


def test_other_objects_are_refused():
    for value in (object(), {1, 2}, np.array([object()])):
        with pytest.raises(
            TypeError, match="cannot be written as bytes: a state consists of"
        ):
            encode([value], OF)


@given(st.binary() | st.text().map(str.encode))
def test_other_bytes_are_refused(data):
    with pytest.raises(ValueError, match="is no saved state"):
        decode(data, OF)


@pytest.mark.parametrize(
    "old, new, message",
    [
        (
            b"an FMU",
            b"another",
            "state of something else: FMU is 'another' there, 'an FMU' here$",
        ),
        (
            b'"step": 0.1',
            b'"stop": 0',
            "step is None there, 0.1 here; stop is 0 there, None here",
        ),
        (b"8D8", b"8D9", r"it is damaged or cut off \([0-9]+ bytes\)"),
        (b"]}", b"]", "it is damaged or cut off"),
    ],
)
def test_damage_is_noticed(old, new, message):
    data = encode({"x": np.ones(3)}, OF)
    assert old in data
    with pytest.raises(ValueError, match=message):
        decode(data.replace(old, new), OF)


@pytest.mark.parametrize(
    "old, new, message",
    [
        (b'"array"', b'"matrix"', "it is damaged: unknown entry 'matrix'"),
        (b"[3]", b"[4]", "it is damaged: cannot reshape"),
        (b'"<f8"', b'"O"', "it is damaged"),
        (b"[3]", b"[" * 100_000, "it is damaged"),
        (b'"dict"', b'"snapshot"', "it is damaged"),
    ],
)
def test_damage_that_knows_its_hash_runs_no_code(old, new, message):
    head, body = encode({"x": np.ones(3)}, OF).split(b"\n")
    forged = body.replace(old, new)
    assert forged != body
    head = head.replace(
        sha256(body).hexdigest().encode(), sha256(forged).hexdigest().encode()
    )
    with pytest.raises(ValueError, match=message):
        decode(head + b"\n" + forged, OF)


def test_bytes_that_are_cut_off_are_refused():
    """Wherever they are cut off, and with any bit turned."""
    data = encode({"x": NUMBERS}, OF)
    for k in range(len(data)):
        with pytest.raises(ValueError, match=r"no saved state|cut off"):
            decode(data[:k], OF)
        with pytest.raises(ValueError, match=r"^it (is|was) "):
            decode(data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :], OF)
