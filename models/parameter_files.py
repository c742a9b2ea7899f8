"""Reading of parameter files: TOML files in which every value has a unit and, optionally, a source.

A value is ``mass = {value = 0.99, unit = "kg", source = "paper, Table 2"}``, as in all shipped files, or
``mass = "0.99 kg"``. The reader states the expected unit. The first form must have this unit; the second is
converted.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.units import factor
from trussflow.blocks.support.files import reading
from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.validation import frozen_array

_NUMBERS = re.compile(r"\s*(\[.*\]|[-+.\deE]*)\s*(.*?)\s*$", re.DOTALL)
"""Pattern of numbers followed by a unit."""


def shipped_file(name: str) -> Path:
    """Return the path of a shipped parameter file.

    Parameters
    ----------
    name : str
        File name, for example ``"transport.toml"``.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    ModelError
        If the file does not exist; the message lists the shipped files.
    """
    folder = Path(str(files("trussflow.models"))) / "parameters"
    path = folder / name
    if not os.path.isfile(path):
        there = ", ".join(
            sorted(p.name for p in folder.iterdir() if p.suffix in (".toml", ".json"))
        )
        raise ModelError(
            f"no parameter file {name!r} comes with trussflow; there are: {there}"
        )
    return path


class TableReader:
    """Reading of the values of a table; derived classes define where the values are."""

    __slots__ = ()

    def owner(self, key: str) -> ParameterTable:
        """Return the table of one file that has a key, for messages.

        Parameters
        ----------
        key : str
            Name of the key.
        """
        raise NotImplementedError

    def find(self, key: str) -> Any:
        """Return the entry of a key, as parsed.

        Parameters
        ----------
        key : str
            Name of the key.

        Raises
        ------
        ModelError
            If the key is missing.
        """
        raise NotImplementedError

    def error(self, key: str, what: str) -> ModelError:
        """Return an error about a key, with its line number.

        Parameters
        ----------
        key : str
            Name of the key.
        what : str
            Description of the error.
        """
        owner = self.owner(key)
        return ModelError(f"{owner.place}: {key!r} {what}{owner.line_of(key)}")

    def text(self, key: str) -> str:
        """Return a plain text.

        Parameters
        ----------
        key : str
            Name of the key.

        Returns
        -------
        str

        Raises
        ------
        ModelError
            If the key is missing or its value is not text.
        """
        return str(self._of_type(key, str, "text in quotes"))

    def whole(self, key: str) -> int:
        """Return a whole number, which has no unit.

        Parameters
        ----------
        key : str
            Name of the key.

        Raises
        ------
        ModelError
            If the key is missing or its value is not a whole number.
        """
        return int(self._of_type(key, int, "a whole number"))

    def _of_type(self, key: str, kind: type, what: str) -> Any:
        """Return the entry of a key, which must be of a type; bool is not int."""
        found = self.find(key)
        if not isinstance(found, kind) or isinstance(found, bool):
            raise self.error(key, f"must be {what}, got {found!r}")
        return found

    def mapping(self, key: str) -> Mapping[str, Any]:
        """Return the content of a table, as parsed."""
        found: Mapping[str, Any] = self._of_type(key, Mapping, "a table")
        return found

    def texts(self, key: str) -> list[str]:
        """Return one text or several.

        Parameters
        ----------
        key : str
            Name of the key.

        Raises
        ------
        ModelError
            If the key is missing, or its value is neither text nor a list of texts.
        """
        found = self.find(key)
        several = [found] if isinstance(found, str) else found
        if not several or {type(one) for one in several} != {str}:
            raise self.error(
                key, f"must be text in quotes, or a list of such, got {found!r}"
            )
        return several

    def rows(self, key: str) -> list[list[int]]:
        """Return rows of whole numbers; a single number is a row.

        Parameters
        ----------
        key : str
            Name of the key.

        Raises
        ------
        ModelError
            If the key is missing, or its value is not a list of whole numbers and lists of them.
        """
        what = "a list of whole numbers, or of lists of them"
        found = self._of_type(key, list, what)
        rows = [one if isinstance(one, list) else [one] for one in found]
        if not rows or not all(
            row and all(type(n) is int for n in row) for row in rows
        ):
            raise self.error(key, f"must be {what}, got {found!r}")
        return rows

    def choice(self, key: str, choices: Iterable[str]) -> str:
        """Return one of several words.

        Parameters
        ----------
        key : str
            Name of the key.
        choices : iterable of str
            Allowed words.

        Raises
        ------
        ModelError
            If the key is missing or its value is not allowed.
        """
        found, allowed = self.text(key), tuple(choices)
        if found not in allowed:
            raise self.error(key, f"is {found!r}; choose from: {', '.join(allowed)}")
        return found

    def scalar(self, key: str, unit: str) -> float:
        """Return a number.

        Parameters
        ----------
        key : str
            Name of the value.
        unit : str
            Required unit, for example ``"kg"``.

        Returns
        -------
        float

        Raises
        ------
        ModelError
            If the key, its value, unit or source is missing, or the unit or type is wrong.
        """
        return float(self.array(key, unit, ()))

    def scalars(self, **units: str) -> dict[str, Any]:
        """Return several numbers by name, each with its required unit."""
        return {key: self.scalar(key, unit) for key, unit in units.items()}

    def optional(self, **units: str) -> dict[str, float]:
        """Return those of several numbers that the table has, by name, each with its required unit."""
        return {key: self.scalar(key, units[key]) for key in units if key in self}

    def __contains__(self, key: str) -> bool:
        raise NotImplementedError

    def array(self, key: str, unit: str, shape: tuple[int | None, ...]) -> Vector:
        """Return an array of numbers.

        Parameters
        ----------
        key : str
            Name of the value.
        unit : str
            Required unit, for example ``"kg*m^2"``.
        shape : tuple of int or None
            Required shape; None allows any length.

        Returns
        -------
        array

        Raises
        ------
        ModelError
            If the key, its value, unit or source is missing, the unit or shape is wrong, or a number
            is not finite.
        """
        entry = self.find(key)
        if isinstance(entry, str):
            return self._checked(key, self._converted(key, entry, unit), shape)
        if not isinstance(entry, Mapping):
            raise self.error(
                key,
                f"must read {{value = ..., unit = ..., source = ...}}, or text such as '1.5 {unit}'",
            )
        for part in ("value", "unit", "source"):
            if part not in entry:
                raise self.error(
                    key, f"has no {part!r}; each value states value, unit, source"
                )
        if entry["unit"] != unit:
            raise self.error(
                key, f"is given in {entry['unit']!r}; it must be in {unit!r}"
            )
        return self._checked(key, entry["value"], shape)

    def _checked(self, key: str, value: Any, shape: tuple[int | None, ...]) -> Vector:
        owner = self.owner(key)
        try:
            return frozen_array(f"{owner.place}: {key!r}", value, shape)
        except ModelError as error:
            raise ModelError(f"{error}{owner.line_of(key)}") from error

    def _converted(self, key: str, text: str, unit: str) -> Any:
        """Return the numbers of a text such as ``"[0, 0, 60] deg"``, in the required unit."""
        number, given = _NUMBERS.match(text).groups()  # type: ignore[union-attr]  # it matches anything
        try:
            values = json.loads(number)
            return values if given == unit else np.multiply(values, factor(given, unit))
        except (ValueError, TypeError, BlockError) as error:
            why = f": {error}" if isinstance(error, BlockError) else ""
            form = (
                f"text such as '1.5 {unit}'"
                if unit != "1"
                else "text such as '1.5' or '3 %'"
            )
            raise self.error(
                key, f"is {text!r}; it must be {form}, or [1, 2] for several{why}"
            ) from error


@dataclass(frozen=True, slots=True)
class ParameterTable(TableReader):
    """Table of a parameter file, with its place for error messages.

    Attributes
    ----------
    content : mapping
        Content of the table, as parsed.
    place : str
        File and table, for example ``robot_arm_literal.toml, base``.
    written : str
        Text of the file from the head of the table; without it, errors have no line numbers.
    line : int
        Number of lines before that text [-].
    """

    content: Mapping[str, Any]
    place: str
    written: str = ""
    line: int = 0

    @classmethod
    def read(cls, path: str | Path) -> ParameterTable:
        """Read a whole parameter file.

        Parameters
        ----------
        path : str or pathlib.Path
            TOML file.

        Returns
        -------
        ParameterTable

        Raises
        ------
        ModelError
            If the file does not exist or is not TOML.
        """
        with reading(
            path, ModelError, "cannot read parameter file", "it is not TOML ({})"
        ) as file:
            text = file.read_text(encoding="utf-8")
            return cls(tomllib.loads(text), Path(path).name, text)

    @classmethod
    def shipped(cls, name: str) -> ParameterTable:
        """Read a shipped parameter file; see `shipped_file`."""
        return cls.read(shipped_file(name))

    def only(self, *keys: str) -> None:
        """Raise `ModelError` for unknown keys.

        Parameters
        ----------
        *keys : str
            Known keys of the table.

        Raises
        ------
        ModelError
            If the table has another key.
        """
        for key in self.content:
            if key not in keys:
                raise ModelError(
                    f"{self.place}: unknown key {key!r}; there are: {', '.join(keys)}"
                )

    def table(self, key: str) -> ParameterTable:
        """Return a sub-table.

        Parameters
        ----------
        key : str
            Name of the key.

        Returns
        -------
        ParameterTable

        Raises
        ------
        ModelError
            If no table has that name.
        """
        found = self.mapping(key)
        above = r"[\w.]*\b" if "," in self.place else ""
        return self._below(
            found, f"{self.place}, {key}", rf"\[{above}{re.escape(key)}\]", 0
        )

    def tables(self, key: str) -> list[ParameterTable]:
        """Return the tables of an array of tables with the heads ``[[key]]``.

        Parameters
        ----------
        key : str
            Name in the double brackets.

        Returns
        -------
        list of ParameterTable

        Raises
        ------
        ModelError
            If no array of tables has that name.
        """
        found = self.find(key)
        if not isinstance(found, list) or not all(
            isinstance(t, Mapping) for t in found
        ):
            raise self.error(key, f"must be an array of tables, each headed [[{key}]]")
        head = rf"\[\[{re.escape(key)}\]\]"
        return [
            self._below(t, f"{self.place}, {key}[{i}]", head, i)
            for i, t in enumerate(found)
        ]

    def _below(
        self, content: Mapping[str, Any], place: str, head: str, number: int
    ) -> ParameterTable:
        """Return a sub-table by the pattern of its `head` and the `number` of that head."""
        heads = list(re.finditer(rf"^[ \t]*{head}", self.written, re.MULTILINE))
        start = heads[number].start() if len(heads) > number else len(self.written)
        return ParameterTable(
            content,
            place,
            self.written[start:],
            self.line + self.written[:start].count("\n"),
        )

    def line_of(self, key: str) -> str:
        """Return the line number of a key for messages, if it is known.

        Parameters
        ----------
        key : str
            Name of the key.
        """
        name = rf"[\"']?{re.escape(key)}[\"']?[ \t]*"
        found = re.search(
            rf"^[ \t]*({name}=|\[+[ \t]*{name}\])", self.written, re.MULTILINE
        )
        return (
            f" (line {self.line + self.written[: found.start()].count(chr(10)) + 1})"
            if found
            else ""
        )

    def listed(self) -> list[tuple[str, ...]]:
        """Return place, value, unit and source of all values, sub-tables included, as text."""
        found: list[tuple[str, ...]] = []
        for key, entry in self.content.items():
            if isinstance(entry, Mapping) and "value" in entry:
                found.append(
                    (
                        f"{self.place}, {key}",
                        *(str(entry[k]) for k in ("value", "unit", "source")),
                    )
                )
            elif isinstance(entry, Mapping | list):
                below = (
                    [self.table(key)]
                    if isinstance(entry, Mapping)
                    else self.tables(key)
                )
                found += [row for table in below for row in table.listed()]
        return found

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def owner(self, key: str) -> ParameterTable:
        """Return this table."""
        return self

    def find(self, key: str) -> Any:
        """Return the entry of a key, as parsed."""
        if key not in self.content:
            there = ", ".join(self.content) or "nothing"
            raise self.error(key, f"is missing; found {there}")
        return self.content[key]
