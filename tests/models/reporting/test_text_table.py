"""Tables for people to read."""

from trussflow.models.reporting.text_table import text_table


def test_columns_are_as_wide_as_their_widest_cell() -> None:
    expected = "name   value\n-----  -----\nmass   1\nwidth  2.275"
    assert text_table(("name", "value"), [("mass", "1"), ("width", "2.275")]) == expected


def test_no_rows_and_no_spaces_at_the_ends() -> None:
    assert text_table(("a", "bc"), []) == "a  bc\n-  --"
    assert text_table(("a", "bc"), [("x", "")]) == "a  bc\n-  --\nx"
