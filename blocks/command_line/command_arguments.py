"""Common parts of all commands: parsers, output, exit codes, and references to Python objects."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import importlib.util
import json
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trussflow.blocks.errors import DiagramError, TrussflowError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.support.validation import meant, shown

FAILED, MISUSED, STOPPED = 1, 2, 130
"""Exit codes: the command failed, its arguments or models are wrong, or Ctrl-C stopped it. 0 is success."""


class Outcome(NamedTuple):
    """Result of a command: `text` for users, `facts` for other programs, and the exit `code`."""

    facts: Any
    text: str = ""
    code: int = 0


def ended(
    command: Callable[[argparse.Namespace], Outcome], options: argparse.Namespace
) -> int:
    """Run a `command` with its `options`, print the result, and return the exit code.

    With ``--json``, standard output contains only the facts: other output of the command and of the user's
    code is redirected to standard error. An error that the user can correct is one line, not a traceback.
    """
    try:
        with (
            contextlib.redirect_stdout(sys.stderr)
            if options.json
            else contextlib.nullcontext()
        ):
            facts, text, code = command(options)
        if told := json_of(facts) if options.json else text:
            print(told, flush=True)
        return code
    except BrokenPipeError:  # the reader, such as head, has closed the pipe
        # Python flushes stdout at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except TrussflowError as error:
        print(f"{_coloured('error:')} {error}", file=sys.stderr)
        return MISUSED
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return STOPPED


def main_of(
    command: Callable[[argparse.Namespace], Outcome],
    parser: Callable[[str], argparse.ArgumentParser],
) -> Callable[[list[str], str], int]:
    """Return the function that runs a `command` with words and the name of the program, by its `parser`."""
    return lambda words, prog: ended(command, parser(prog).parse_args(words))


def parser_of(prog: str, description: str, *examples: str) -> argparse.ArgumentParser:
    """Return a parser whose help ends with examples.

    Parameters
    ----------
    prog : str
        Name of the command.
    description : str
        Purpose of the command.
    *examples : str
        Example arguments, each with a comment after ``#``.
    """
    lines = [f"  {prog} {line}" for line in examples]
    found = argparse.ArgumentParser(
        prog=prog,
        description=description,
        epilog="\n".join(["examples:", *lines]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_json(found)
    return found


def add_diagram(parser: argparse.ArgumentParser) -> None:
    """Add the argument ``item``, which `block_of` reads, to a `parser`."""
    parser.add_argument(
        "item",
        help="module:name or file.py:name of a diagram, or of a function returning one",
    )


def add_json(parser: argparse.ArgumentParser, **settings: Any) -> None:
    """Add the option ``--json``, which `ended` evaluates, to a `parser`, with `settings` of argparse."""
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the result as JSON, for other programs",
        **settings,
    )


def json_of(thing: Any) -> str:
    """Return a `thing` of plain values, arrays and paths as JSON; NaN and infinity are null."""

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        if isinstance(value, Path):
            return str(value)
        raise TypeError(f"cannot print a {type(value).__name__} as JSON")

    finite = json.loads(json.dumps(thing, default=plain), parse_constant=lambda _: None)
    return json.dumps(finite, indent=2)


def block_of(reference: str) -> Block:
    """Return the block with the reference ``module:name`` or ``file.py:name``.

    Parameters
    ----------
    reference : str
        Module or file, and name of a block in it, or of a function without arguments that returns a block.

    Raises
    ------
    DiagramError
        If there is no such object, or it is not a block.
    """
    module, _, name = reference.partition(":")
    thing: Any = _loaded(module, reference)
    for part in filter(None, name.split(".")):
        if not hasattr(thing, part):
            there = [n for n in getattr(thing, "__dict__", {}) if n[0] != "_"]
            raise DiagramError(
                f"'{reference}': there is no '{part}'{meant(part, there)}"
            )
        thing = getattr(thing, part)
    if callable(thing) and not isinstance(thing, Block):
        try:
            thing = thing()
        except TypeError as error:
            raise DiagramError(
                f"'{reference}' cannot be called without arguments: {error}; name a function that "
                "returns the block"
            ) from error
    if not isinstance(thing, Block):
        raise DiagramError(
            f"'{reference}' is {shown(thing)}, not a block; write module:name or file.py:name of a block"
        )
    return thing


def values_of(option: str, texts: Iterable[str]) -> dict[str, Any]:
    """Return the values of an `option` by name, from `texts` of the form ``name=value``.

    Raises
    ------
    DiagramError
        If a text is not an assignment of numbers.
    """
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            found[name] = json.loads(value)
        except json.JSONDecodeError as error:
            raise DiagramError(
                f"{option} {text}: write name=number, or name=[number, number]"
            ) from error
    return found


def _loaded(module: str, reference: str) -> Any:
    """Import the module of a `reference` by its name or file, with its folder on the search path."""
    try:
        if not module.endswith(".py"):
            sys.path.insert(0, os.getcwd())  # as python -m does
            return importlib.import_module(module)
        file = Path(module).resolve()
        spec = importlib.util.spec_from_file_location(file.stem, file)
        assert spec is not None
        assert spec.loader is not None
        loaded = importlib.util.module_from_spec(spec)
        sys.path.insert(0, str(file.parent))
        sys.modules[file.stem] = (
            loaded  # pickle and dataclasses look up the module of a class
        )
        spec.loader.exec_module(loaded)
    except (ImportError, SyntaxError, ValueError, OSError) as error:
        raise DiagramError(
            f"cannot import '{module}' for '{reference}': {error}"
        ) from error
    return loaded


def _coloured(text: str) -> str:
    """Return a `text` in red if standard error is a terminal with colours."""
    return (
        f"\033[31m{text}\033[0m"
        if sys.stderr.isatty() and not os.environ.get("NO_COLOR")
        else text
    )
