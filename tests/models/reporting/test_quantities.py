"""Numbers for people to read, compared with the numbers themselves and with pint."""

import math

import pytest

from trussflow.blocks.framework.units import factor
from trussflow.models.reporting.quantities import PREFIXES, prefixed, shortened

POWERS = {sign: power for power, sign in PREFIXES.items() if sign}


@pytest.mark.parametrize(
    "value, unit, shown",
    [
        (1.611, "N", ("1.61", "N")),
        (4.072e-6, "m", ("4.07", "µm")),
        (7e10, "Pa", ("70", "GPa")),
        (0.2698, "N*m", ("0.27", "N·m")),
        (6.021e-2, "N*m", ("60.2", "mN·m")),
        (-6.6e-4, "m/s^2", ("-660", "µm/s²")),
        (999.96, "N", ("1", "kN")),
        (0.0, "rad", ("0", "rad")),
        (5400.0, "s", ("5400", "s")),
        (0.002, "m^2", ("0.002", "m²")),
        (0.02, "kg**0.5*m", ("0.02", "kg^½·m")),
        (0.001, "min", ("0.001", "min")),
        (math.inf, "m", ("inf", "m")),
    ],
)
def test_prefixes_are_those_of_engineers(value, unit, shown):
    assert prefixed(value, unit) == shown


def test_shown_numbers_are_the_numbers_to_their_digits(rng):
    for unit in ("m", "N*m", "rad/s", "kg", "m^3", "Pa"):
        for value in rng.normal(size=40) * 10.0 ** rng.uniform(-11, 11, 40):
            number, shown = prefixed(value, unit)
            prefix = shown[0] if prefixed(1.0, unit)[1] != shown else ""
            scale = 10.0 ** POWERS[prefix] if prefix else 1.0
            assert float(number) * scale == pytest.approx(value, rel=5.1e-3)
            if prefix:
                plain = shown[1:].replace("·", "*")
                given = shown.replace("µ", "u").replace("·", "*")
                assert factor(given, plain) == pytest.approx(scale)


@pytest.mark.parametrize(
    "text, short",
    [
        ("70000000000.0 Pa", "70 GPa"),
        ("-1.0471975511965976 rad", "-1.047198 rad"),
        ("[2.0, 1.2, 0.16666666666666666]", "[2, 1.2, 0.1666667]"),
        ("[[0.0, 1e-09], [7.65, -0.5]] m", "[[0, 1e-09], [7.65, -0.5]] m"),
        ("0.001 m/s", "1 mm/s"),
        ("10", "10"),
        ("auto", "auto"),
        ("[torque, 1] x", "[torque, 1] x"),
        ("2 of 3", "2 of 3"),
    ],
)
def test_values_of_parameter_files(text, short):
    assert shortened(text) == short
