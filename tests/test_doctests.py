"""The examples in the docstrings give what they say."""

import doctest
import importlib


def test_examples_in_docstrings(module_name):
    module = importlib.import_module(module_name)
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    assert doctest.testmod(module, optionflags=flags).failed == 0
