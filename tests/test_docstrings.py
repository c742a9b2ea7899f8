"""Rules about public docstrings: each parameter is described, numbers have units, examples are true.

Ruff checks that docstrings exist and have the form of numpydoc.
"""

import doctest
import enum
import inspect
import re
from importlib import import_module

from numpydoc.docscrape import NumpyDocString
from sources import PUBLIC_MODULES

from trussflow.blocks import Block

SECTIONS = ("Parameters", "Other Parameters", "Attributes")
UNIT = re.compile(r"\[[^\[\]]+\]")
NUMERIC = re.compile(r"\b(float|float64|complex|Vector|Matrix)\b")
NOT_NUMBERS = re.compile(r"Callable|dict|Mapping|bool_|intp|int64")


def defined(module_name):
    """Yield what a module defines for others to call: its name, the callable, its docstrings.

    A class may leave to its bases what they say, a method to its class and to what it overrides.
    """
    for name, item in vars(import_module(module_name)).items():
        if name.startswith("_") or getattr(item, "__module__", "") != module_name:
            continue
        if inspect.isfunction(item):
            yield name, item, docstrings(item)
        elif inspect.isclass(item) and not issubclass(item, enum.Enum | BaseException):
            of_class = docstrings(*item.__mro__[:-1])
            if {"__init__", "__new__"} & set(vars(item)) and not is_protocol(item):
                yield name, item, of_class
            for member_name, member in vars(item).items():
                function = getattr(member, "__func__", member)
                # Matplotlib adds a function of its own to each class of figures.
                if (
                    inspect.isfunction(function)
                    and function.__module__ == module_name
                    and not member_name.startswith("_")
                ):
                    versions = [vars(base).get(member_name) for base in item.__mro__]
                    yield (
                        f"{name}.{member_name}",
                        function,
                        docstrings(*versions) + of_class,
                    )


def is_protocol(item):
    """Tell whether a class only says what others must have."""
    return getattr(item, "_is_protocol", False)


def docstrings(*items):
    """Return the docstrings of those items that have one."""
    return [
        inspect.cleandoc(item.__doc__)
        for item in items
        if item is not None and item.__doc__
    ]


def parameters_of(function):
    """Return the annotation of each public parameter, as text."""
    named = inspect.signature(function).parameters
    return {
        name: kind.annotation
        if isinstance(kind.annotation, str)
        else str(kind.annotation)
        for name, kind in named.items()
        if name not in ("self", "cls") and not name.startswith("_")
    }


def explanations(docs):
    """Return what docstrings say of each parameter: type and text in a section, or a sentence."""
    found = {}
    for doc in docs:
        parsed = NumpyDocString(doc)
        for entry in (entry for section in SECTIONS for entry in parsed[section]):
            for name in re.split(r",\s*", entry.name):
                found.setdefault(name.lstrip("*"), " ".join([entry.type, *entry.desc]))
        for name in re.findall(r"(?<!`)`(\w+)`(?!`)", doc):
            found.setdefault(name, doc)
    return found


def is_numeric(annotation):
    """Tell whether an annotation stands for physical numbers."""
    return bool(NUMERIC.search(annotation)) and not NOT_NUMBERS.search(annotation)


def test_parameters_are_documented():
    """A parameter is in a section or in backticks; a single one may be left to the summary."""
    missing = []
    for module in PUBLIC_MODULES:
        for name, function, docs in defined(module):
            parameters = parameters_of(function)
            if len(parameters) > 1 or inspect.isclass(function):
                documented = explanations(docs)
                missing += [
                    f"{module}.{name}({p})" for p in parameters if p not in documented
                ]
    assert missing == []


def test_numeric_parameters_have_units():
    """Write [1] for numbers without unit, and [any] for those of any unit."""
    missing = []
    for module in PUBLIC_MODULES:
        for name, function, docs in defined(module):
            documented = explanations(docs)
            for parameter, annotation in parameters_of(function).items():
                text = documented.get(parameter, " ".join(docs))
                if is_numeric(annotation) and not UNIT.search(text):
                    missing.append(f"{module}.{name}({parameter})")
    assert missing == []


def test_blocks_have_a_plain_first_line():
    """It is the description of an exported FMU, where TeX stays as it is."""
    marked = [
        f"{module}.{name}"
        for module in PUBLIC_MODULES
        for name, item, docs in defined(module)
        if inspect.isclass(item) and issubclass(item, Block)
        if ":math:" in docs[0].splitlines()[0]
    ]
    assert marked == []


def test_examples_in_docstrings_print_as_shown():
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    results = {
        name: doctest.testmod(import_module(name), optionflags=flags)
        for name in PUBLIC_MODULES
    }
    assert [name for name, result in results.items() if result.failed] == []
    assert sum(result.attempted for result in results.values()) > 0
