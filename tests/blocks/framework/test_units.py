"""Strings that are units, and strings that are none."""

import pint
import pytest

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.units import mismatch, parse, readable


@pytest.mark.parametrize(
    "unit", ["foo", "foobar", "m/", "m**", "3 m", "m**s", "1/0", "(", 5]
)
def test_what_is_no_unit_is_named_with_a_reason(unit):
    with pytest.raises(
        BlockError, match=r"^unknown unit .+: .*\w"
    ) as caught:  # the reason is pint's wording
        parse(unit)
    assert repr(unit) in str(caught.value)
    near = str(caught.value).partition("did you mean ")[2].split(" or ")
    assert len(near) == len({*near}), near


@pytest.mark.parametrize(
    "unit, same", [("", "1"), ("°", "deg"), ("N*m", "J"), ("dB", "decibel")]
)
def test_what_is_a_unit_is_read(unit, same):
    assert mismatch(unit, same) == ""


@pytest.mark.parametrize(
    "error, kind, message",
    [
        (AssertionError(), BlockError, "unknown unit 'm': it cannot be parsed"),
        (ImportError("no flexparser"), ImportError, "no flexparser"),
        (
            RuntimeError("cannot read its definitions"),
            RuntimeError,
            "cannot read its definitions",
        ),
    ],
)
def test_a_broken_pint_is_not_called_an_unknown_unit(error, kind, message, monkeypatch):
    """An error of pint without a message gets one."""

    def broken(*_):
        raise error

    monkeypatch.setattr(pint.UnitRegistry, "parse_units", broken)
    parse.cache_clear()
    with pytest.raises(kind, match=message):
        parse("m")


@pytest.mark.parametrize(
    "unit, shown",
    [
        ("kg**0.5*m/s**2", "kg^½·m/s²"),
        ("N*m", "N·m"),
        ("kg*m^2/s^3", "kg·m²/s³"),
        ("", ""),
        ("1", "1"),
        ("m^20", "m^20"),
    ],
)
def test_a_unit_is_shown_as_people_write_it(unit, shown):
    assert readable(unit) == shown
