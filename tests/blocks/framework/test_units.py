"""Strings that are units, and strings that are none."""

from typing import Any

import pint
import pytest

from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.units import mismatch, parse


@pytest.mark.parametrize(
    ("unit", "reason"),
    [
        ("foo", "'foo' is not defined"),
        ("m/", "it cannot be read"),
        ("m**", "it cannot be read"),
        ("3 m", "cannot have a scaling factor"),
        ("m**s", "unsupported operand"),
        ("1/0", "division by zero"),
        ("(", "EOF"),
        (5, "must be of type str"),
    ],
)
def test_what_is_no_unit_is_named(unit: Any, reason: str) -> None:
    with pytest.raises(BlockError, match=r"unknown unit ") as caught:
        parse(unit)
    assert repr(unit) in str(caught.value)
    assert reason in str(caught.value)


@pytest.mark.parametrize(("unit", "same"), [("", "1"), ("°", "deg"), ("N*m", "J"), ("dB", "decibel")])
def test_what_is_a_unit_is_read(unit: str, same: str) -> None:
    assert mismatch(unit, same) == ""


@pytest.mark.parametrize("error", [ImportError("no flexparser"), RuntimeError("cannot read its definitions")])
def test_a_broken_pint_is_not_called_an_unknown_unit(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise error

    monkeypatch.setattr(pint.UnitRegistry, "parse_units", broken)
    parse.cache_clear()
    with pytest.raises(type(error), match=str(error)):
        parse("m")
