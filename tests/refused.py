"""Calls that are refused, from files like doctests: a call, then the class of its error and a pattern of its text."""

import re
from pathlib import Path

import pytest

from trussflow import blocks
from trussflow.blocks import errors

ENTRY = re.compile(r"^>>> (.+)\n(\w+): (.+)$", re.MULTILINE)


def over_calls(file):
    """Return the parametrization of a test over the calls in the file `.calls` beside its file."""
    text = Path(file).with_suffix(".calls").read_text(encoding="utf-8")
    entries = ENTRY.findall(text)
    assert len(entries) == text.count(">>> ")
    return pytest.mark.parametrize(
        "call, error, message", entries, ids=[call for call, *_ in entries]
    )


def check_refused(call, error, message, names):
    """Check the error of a call, which may use these names and those of the blocks."""
    names = vars(blocks) | vars(errors) | names
    with pytest.raises(eval(error, names), match=re.compile(message, re.DOTALL)):
        eval(call, names)
