"""Numbers as people write them, each taken down once."""

import pytest
from study_tools.ledger import Ledger, pretty

from trussflow.models import ModelError


@pytest.mark.parametrize(
    "value, digits, text",
    [
        (0.26976, 3, "0.270"),
        (4.0715e-6, 3, "4.07×10⁻⁶"),
        (-0.0207, 2, "−0.021"),
        (-2.5e-12, 2, "−2.5×10⁻¹²"),
        (9.996, 3, "10.0"),
        (1234.5, 3, "1230"),
        (1.25e7, 2, "1.2×10⁷"),
        (0.0, 3, "0"),
        (float("inf"), 3, "∞"),
        (float("-inf"), 3, "−∞"),
        (float("nan"), 3, "not a number"),
    ],
)
def test_pretty(value, digits, text):
    assert pretty(value, digits) == text


def test_numbers_are_taken_down_with_unit_and_runs():
    ledger = Ledger()
    assert ledger("torque", 0.27, "N*m", runs=["case1"], digits=2) == "0.27 N·m"
    assert ledger("share", 0.5678, "%", digits=2, show_unit=False) == "57"
    assert ledger("runs", 57) == "57"
    assert ledger.numbers["torque"] == {
        "value": 0.27,
        "unit": "N*m",
        "runs": ["case1"],
        "text": "0.27",
    }


def test_one_name_has_one_number():
    ledger = Ledger()
    ledger("torque", 0.27)
    ledger("torque", 0.27)
    with pytest.raises(ModelError, match="two different numbers named 'torque'"):
        ledger("torque", 0.28)
