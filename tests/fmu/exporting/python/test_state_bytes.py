"""States as bytes: everything comes back equal to the bit, and nothing else is accepted."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trussflow.fmu.exporting.python.state_bytes import decode, encode

TOKEN = "an FMU"
NUMBERS = np.random.default_rng(0).standard_normal((2, 3)) * 10.0 ** np.arange(-300, 300, 200)
VALUES: tuple[Any, ...] = (
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
    [],
    (),
    {},
    [(1, [2.5]), {"x": NUMBERS, 3: (b"y",)}],
)


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return (
            isinstance(b, np.ndarray)
            and (a.dtype, a.shape) == (b.dtype, b.shape)
            and a.tobytes() == b.tobytes()
        )
    if isinstance(a, list | tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return isinstance(b, dict) and list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("value", VALUES, ids=str)
def test_what_is_written_is_read_again(value: Any) -> None:
    assert same(value, decode(encode(value, TOKEN), TOKEN))


def test_numbers_that_are_none_and_signed_zero() -> None:
    found = decode(encode([math.nan, math.inf, -0.0, np.float32(0.5)], TOKEN), TOKEN)
    assert math.isnan(found[0])
    assert found[1:] == [math.inf, 0.0, 0.5]
    assert math.copysign(1.0, found[2]) == -1.0


def test_read_arrays_can_be_changed() -> None:
    array = decode(encode(np.ones(3), TOKEN), TOKEN)
    array[0] = 2.0


def test_other_objects_are_refused() -> None:
    for value in (object(), {1, 2}, np.array([object()])):
        with pytest.raises(TypeError, match="cannot be written as bytes: a state consists of"):
            encode([value], TOKEN)


@given(st.binary() | st.text().map(str.encode))
def test_other_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="are no state of this FMU"):
        decode(data, TOKEN)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"an FMU", b"another", "the state of another FMU"),
        (b'"version": 1', b'"version": 2', "or of another version of it"),
        (b'"array"', b'"matrix"', "a damaged state of this FMU: unknown entry 'matrix'"),
        (b"[3]", b"[4]", "a damaged state of this FMU: cannot reshape"),
        (b'"<f8"', b'"O"', "a damaged state of this FMU"),
    ],
)
def test_damage_is_noticed(old: bytes, new: bytes, message: str) -> None:
    data = encode({"x": np.ones(3)}, TOKEN)
    assert old in data
    with pytest.raises(ValueError, match=message):
        decode(data.replace(old, new), TOKEN)
