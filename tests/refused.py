"""Calls that are refused, from files like doctests: a call, then the class of its error and a pattern of its text."""

import re
from pathlib import Path

import pytest

ENTRY = re.compile(r"^>>> (.+)\n(\w+): (.+)$", re.MULTILINE)


def over_calls(file):
    """Return the parametrization of a test over the calls in a text file."""
    text = Path(file).read_text(encoding="utf-8")
    entries = ENTRY.findall(text)
    assert len(entries) == text.count(">>> ")
    return pytest.mark.parametrize(
        "call, error, message", entries, ids=[call for call, *_ in entries]
    )


def check_refused(call, error, message, names):
    """Check the error of a call, whose names are given."""
    with pytest.raises(eval(error, names), match=re.compile(message, re.DOTALL)):
        eval(call, names)
