"""What is public in any module explains every parameter, and gives physical ones a unit.

That everything has a docstring, in numpydoc form, is ruff's to check.
"""

import enum
import importlib
import inspect
import re

from numpydoc.docscrape import NumpyDocString

SECTIONS = ("Parameters", "Other Parameters", "Attributes")
UNIT = re.compile(r"\[[^\[\]]+\]")
NUMERIC = re.compile(r"\b(float|float64|complex|Vector|Matrix)\b")
NOT_NUMBERS = re.compile(r"Callable|dict|Mapping|bool_|intp|int64")


def defined(module_name):
    """Yield what a module defines for others to call: its name, the callable, its docstrings.

    A class may leave to its bases what they say, a method to its class and to what it overrides.
    """
    for name, item in vars(importlib.import_module(module_name)).items():
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
                if inspect.isfunction(function) and not member_name.startswith("_"):
                    versions = [vars(base).get(member_name) for base in item.__mro__]
                    yield f"{name}.{member_name}", function, docstrings(*versions) + of_class


def is_protocol(item):
    """Tell whether a class only says what others must have."""
    return getattr(item, "_is_protocol", False)


def docstrings(*items):
    """Return the docstrings of those items that have one."""
    return [inspect.cleandoc(item.__doc__) for item in items if item is not None and item.__doc__]


def parameters_of(function):
    """Return the annotation of each public parameter, as text."""
    named = inspect.signature(function).parameters
    return {
        name: kind.annotation if isinstance(kind.annotation, str) else str(kind.annotation)
        for name, kind in named.items()
        if name not in ("self", "cls") and not name.startswith("_")
    }


def explanations(docs):
    """Return what docstrings say of each parameter: type and text in a section, or a sentence."""
    found: dict[str, str] = {}
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


def test_parameters_are_documented(module_name):
    """A parameter stands in a section or in backticks; a lone one may be left to the summary."""
    missing = []
    for name, function, docs in defined(module_name):
        parameters = parameters_of(function)
        if len(parameters) > 1 or inspect.isclass(function):
            missing += [f"{name}({p})" for p in parameters if p not in explanations(docs)]
    assert not missing, f"{module_name} does not document {', '.join(missing)}"


def test_numeric_parameters_have_units(module_name):
    """Write [1] for what has no unit, and [any] for what may have any."""
    missing = []
    for name, function, docs in defined(module_name):
        said = explanations(docs)
        for parameter, annotation in parameters_of(function).items():
            text = said.get(parameter, " ".join(docs))
            if is_numeric(annotation) and not UNIT.search(text):
                missing.append(f"{name}({parameter})")
    assert not missing, f"{module_name} gives no [unit] for {', '.join(missing)}"
