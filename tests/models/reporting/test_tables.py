"""Tables for people to read."""

from trussflow.models.reporting.tables import markdown_table, text_table


def test_columns_are_as_wide_as_their_widest_cell():
    expected = "name   value\n-----  -----\nmass   1\nwidth  2.275"
    assert (
        text_table(("name", "value"), [("mass", "1"), ("width", "2.275")]) == expected
    )


def test_no_rows_and_no_spaces_at_the_ends():
    assert text_table(("a", "bc"), []) == "a  bc\n-  --"
    assert text_table(("a", "bc"), [("x", "")]) == "a  bc\n-  --\nx"


def test_markdown():
    assert (
        markdown_table(("a", "b"), [("1", "2")])
        == "| a | b |\n| --- | --- |\n| 1 | 2 |"
    )
