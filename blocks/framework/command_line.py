"""What all command lines have in common: how they end and tell, and what words stand for."""

from __future__ import annotations

import argparse
import contextlib
import difflib
import importlib
import importlib.util
import json
import math
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.errors import DiagramError, TrussflowError
from trussflow.blocks.framework.validation import shown

FAILED, MISUSED, STOPPED = 1, 2, 130
"""Exit codes: what was wanted did not succeed, it made no sense, or Ctrl-C ended it. 0: all is well."""


class Outcome(NamedTuple):
    """How a command ended: its `text` for people, its `facts` for other programs, and its exit `code`."""

    facts: Any
    text: str = ""
    code: int = 0


def ended(command: Callable[[argparse.Namespace], Outcome], options: argparse.Namespace) -> int:
    """Run a `command` with its `options`, tell what came out, and return the exit code.

    With ``--json`` the facts, and nothing else, are on standard output: what the command, or the user's code,
    prints on its way goes to standard error. What the user can mend is one line, not a traceback.
    """
    try:
        with contextlib.redirect_stdout(sys.stderr) if options.json else contextlib.nullcontext():
            facts, text, code = command(options)
        if told := json_of(facts) if options.json else text:
            print(told, flush=True)
        return code
    except BrokenPipeError:  # who reads has enough, as head has
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is written on the way out
        return FAILED
    except TrussflowError as error:
        print(f"{_coloured('error:')} {error}", file=sys.stderr)
        return MISUSED
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return STOPPED


def parser_of(prog: str, description: str, *examples: str) -> argparse.ArgumentParser:
    """Return a parser whose help ends with examples.

    Parameters
    ----------
    prog : str
        How the command is called.
    description : str
        What it does.
    *examples : str
        What may stand behind the command, each with what that does behind a ``#``.
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


def add_json(parser: argparse.ArgumentParser, **settings: Any) -> None:
    """Give a `parser` the option ``--json``, which `ended` heeds, with `settings` of argparse."""
    parser.add_argument(
        "--json", action="store_true", help="print what came out as JSON, for other programs", **settings
    )


def json_of(thing: Any) -> str:
    """Return a `thing` of plain values, arrays and paths as JSON; NaN and infinity are null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {str(name): plain(part) for name, part in value.items()}
        if isinstance(value, list | tuple):
            return [plain(part) for part in value]
        if isinstance(value, np.ndarray | np.generic):
            return plain(value.tolist())
        if isinstance(value, Path):
            return str(value)
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return json.dumps(plain(thing), indent=2, allow_nan=False)


def thing_of(reference: str) -> Any:
    """Return what ``module:name`` or ``file.py:name`` stands for, whatever it is.

    Parameters
    ----------
    reference : str
        A module or a file, and something within it.

    Raises
    ------
    DiagramError
        If there is no such thing.
    """
    module, _, name = reference.partition(":")
    thing: Any = _loaded(module, reference)
    for part in filter(None, name.split(".")):
        if not hasattr(thing, part):
            there = (
                [name for name in vars(thing) if not name.startswith("_")]
                if hasattr(thing, "__dict__")
                else []
            )
            near = difflib.get_close_matches(part, there, 1)
            meant = f"; did you mean '{near[0]}'?" if near else ""
            raise DiagramError(f"'{reference}': there is no '{part}'{meant}")
        thing = getattr(thing, part)
    return thing


def block_of(reference: str) -> Block:
    """Return the block that ``module:name`` or ``file.py:name`` stands for.

    Parameters
    ----------
    reference : str
        A module or a file and, within it, a block, or what returns one when called without arguments.

    Raises
    ------
    DiagramError
        If there is no such thing, or it is no block.
    """
    thing = thing_of(reference)
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
            f"'{reference}' is {shown(thing)}, no block; write module:name or file.py:name of a block"
        )
    return thing


def values_of(option: str, texts: Iterable[str]) -> dict[str, Any]:
    """Return the values that an `option` with ``name=value`` was given in `texts`, by name.

    Raises
    ------
    DiagramError
        If one is no assignment of numbers.
    """
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            found[name] = json.loads(value)
        except json.JSONDecodeError as error:
            raise DiagramError(f"{option} {text}: write name=number, or name=[number, number]") from error
    return found


def _loaded(module: str, reference: str) -> Any:
    """Return a module by its name or by its file, as if it were run from there, for a `reference`."""
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
        sys.modules[file.stem] = loaded  # for what looks up the module of a class
        spec.loader.exec_module(loaded)
    except (ImportError, SyntaxError, ValueError, OSError) as error:
        raise DiagramError(f"cannot import '{module}' for '{reference}': {error}") from error
    return loaded


def _coloured(text: str) -> str:
    """Return a `text` in red, if whoever reads errors sees colours."""
    return f"\033[31m{text}\033[0m" if sys.stderr.isatty() and not os.environ.get("NO_COLOR") else text
