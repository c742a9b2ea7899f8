"""Parameter files that extend others: a value missing in one file is read from the next."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from trussflow.blocks.support.validation import meant
from trussflow.models.errors import ModelError
from trussflow.models.parameter_files import ParameterTable, TableReader, shipped_file

EXTENDS = "extends"
"""Key with the name of the next file: in the same folder, or shipped."""

MISSPELLING_SIMILARITY = 0.75
"""Least similarity by `difflib` at which an unknown key is a misspelling of a missing one [1]."""


class Told(NamedTuple):
    """Value read from a file, with its origin.

    Attributes
    ----------
    key : str
        Table and key.
    value : str
        Value as written.
    place : str
        File of the value.
    source : str
        Source stated in the file; empty if there is none.
    """

    key: str
    value: str
    place: str
    source: str


_PLACED, _QUOTED = re.compile(r"\[|[-.\w]+\.(toml|urdf)\b"), re.compile(r"'[^']*'")


@dataclass(slots=True)
class LayeredFile:
    """Parameter file and those that it extends; the first file with a key has precedence.

    Attributes
    ----------
    layers : list of ParameterTable
        Files, by precedence.
    folder : pathlib.Path
        Folder of the first file, to which file names in it are relative.
    told : dict
        Values read so far, keyed by table and key.
    known : set
        Tables and keys requested so far.
    inner : dict
        Names of overriding tables, keyed by the names of the overridden ones; see `within`.
    """

    layers: list[ParameterTable]
    folder: Path = Path()
    told: dict[tuple[str, str], Told] = field(default_factory=dict)
    known: set[tuple[str, str]] = field(default_factory=set)
    inner: dict[str, str] = field(default_factory=dict)

    @classmethod
    def read(
        cls,
        path: str | Path,
        before: Iterable[ParameterTable] = (),
        otherwise: str = "",
    ) -> LayeredFile:
        """Read a file, and those that it extends.

        Parameters
        ----------
        path : str or pathlib.Path
            TOML file.
        before : iterable of ParameterTable
            Tables with higher precedence, such as command-line options.
        otherwise : str
            File to extend if the first file has no `extends`; by default none.

        Raises
        ------
        ModelError
            If a file cannot be read, or the files extend each other in a cycle.
        """
        layers, seen, place = list(before), [], Path(path)
        while True:
            if place.resolve() in seen:
                raise ModelError(
                    f"{Path(path).name}: {EXTENDS!r} is a cycle back to {place.name}"
                )
            seen.append(place.resolve())
            layers.append(ParameterTable.read(place))
            if EXTENDS in layers[-1]:
                otherwise = layers[-1].text(EXTENDS)
            elif len(seen) > 1 or not otherwise:
                return cls(layers, Path(path).parent)
            following = otherwise
            beside = place.parent / following
            try:
                place = beside if os.path.isfile(beside) else shipped_file(following)
            except ModelError as error:
                raise layers[-1].error(EXTENDS, f"names no file: {error}") from error

    def table(self, name: str) -> LayeredTable:
        """Return the merged table `name` of all files."""
        return LayeredTable(self, self.inner.get(name, name), name)

    def named(self, key: str) -> str:
        """Return the text of a top-level `key`."""
        layer = next((layer for layer in self.layers if key in layer), self.layers[0])
        return layer.text(key)

    def missing(self, table: str, *keys: str) -> ModelError:
        """Return an error about `keys` that are missing in the `table` of all files."""
        for each in self.layers:  # a misspelling is the most likely reason
            given = _part(each, table)
            unknown = [k for k in given.content if (table, k) not in self.known]
            for key in keys:
                if near := difflib.get_close_matches(
                    key, unknown, 1, MISSPELLING_SIMILARITY
                ):
                    return given.error(
                        near[0], f"is an unknown key; did you mean {key!r}?"
                    )
        places = ", ".join(layer.place for layer in self.layers if layer.content)
        return ModelError(
            f"[{table}] has no {' and no '.join(map(repr, keys))} in any of {places}"
        )

    def elements(self, name: str, count: int) -> list[LayeredTable]:
        """Return `count` tables: those of an array `name`, or the common table repeated.

        Raises
        ------
        ModelError
            If an array has another number of tables.
        """
        arrays = [
            layer for layer in self.layers if isinstance(layer.content.get(name), list)
        ]
        for layer in arrays:
            if (given := len(layer.tables(name))) != count:
                raise layer.error(
                    name,
                    f"has {given} tables; write [[{name}]] {count} times, or [{name}] once for all",
                )
        return [self.table(f"{name}[{k}]" if arrays else name) for k in range(count)]

    def within(self, name: str, *tables: str) -> LayeredFile:
        """Return this file with `tables` overridden by the sub-tables of the table `name`."""
        return replace(self, inner={table: f"{name}.{table}" for table in tables})

    @contextmanager
    def blamed(self, table: str = "", key: str = "") -> Iterator[None]:
        """Add file and line of the key to errors that name no file; the key is `key` by default.

        Otherwise it is a key in the text of the error, of this `table` or of a table in that text.
        """
        try:
            yield
        except ModelError as error:
            said = str(error)
            if _PLACED.match(said) or any(
                said.startswith(layer.place) for layer in self.layers
            ):
                raise
            words = _QUOTED.sub("", said)
            found = [
                (-len(k), at.start(), t, k)
                for t, k in self.told
                if (t == table or f"{t}:" in words)
                and (at := re.search(rf"\b{k.removesuffix('s')}", words))
            ]
            if not (found or key):
                raise
            *_, table, key = min(found, default=(table, key))
            raise self.table(table).error(key, f"is refused: {said}") from error

    def refuse_tables(self, tables: Collection[str]) -> None:
        """Raise `ModelError` for a table or top-level key that is not in `tables`; propose the nearest."""
        for layer in self.layers:
            for name in layer.content:
                if name not in tables:
                    raise layer.error(
                        name,
                        f"is not a key or table of a mission{_proposal(name, tables)}",
                    )

    def refuse_others(self) -> None:
        """Raise `ModelError` for a key that was not requested; propose the nearest, or list all."""
        tables = {table for table, _ in self.known}
        for layer, name in product(self.layers, sorted(tables)):
            part = _part(layer, name)
            keys = [key for table, key in self.known if table == name]
            for key in part.content:
                if key not in keys and f"{name}.{key}" not in tables:
                    raise part.error(key, f"is an unknown key{_proposal(key, keys)}")


def _part(layer: ParameterTable, name: str) -> ParameterTable:
    """Return a table of a file, empty if it is missing.

    ``robots[1].wheels`` is the table ``wheels`` in the second table of the array ``[[robots]]``, or in the
    table ``[robots]`` of a file without an array.
    """
    for step in name.split("."):
        key, _, number = step.partition("[")
        if key not in layer:
            return ParameterTable({}, layer.place)
        several = number and isinstance(layer.content[key], list)
        layer = layer.tables(key)[int(number[:-1])] if several else layer.table(key)
    return layer


def _proposal(word: str, words: Collection[str]) -> str:
    """Return the end of a message about an unknown word: the nearest of `words`, or all of them."""
    return meant(word, words) or f"; there are {', '.join(sorted(words))}"


@dataclass(frozen=True, slots=True)
class LayeredTable(TableReader):
    """Table of a `LayeredFile`.

    Attributes
    ----------
    file : LayeredFile
        File of the table.
    name : str
        Name of the table.
    general : str
        Name of the table with the defaults of this one; equal to `name` if there is none.
    """

    file: LayeredFile
    name: str
    general: str

    def _found(self, key: str) -> tuple[str, ParameterTable | None, ParameterTable]:
        """Return the table with a `key`: its name, the file, None if there is none, and the part of the file."""
        for name, layer in product((self.name, self.general), self.file.layers):
            self.file.known.add((name, key))
            if key in (part := _part(layer, name)):
                return name, layer, part
        return self.general, None, self.file.layers[0]

    def __contains__(self, key: str) -> bool:
        return self._found(key)[1] is not None

    def owner(self, key: str) -> ParameterTable:
        """Return the table of the first file with a `key`, or the first file."""
        return self._found(key)[2]

    def find(self, key: str) -> Any:
        """Return the entry of a `key` in the first file that has it, and record its origin."""
        place, layer, part = self._found(key)
        if layer is None:
            raise self.file.missing(place, key)
        entry = part.content[key]
        value, source = str(entry), ""
        if isinstance(entry, dict) and "value" in entry:
            value, source = (
                f"{entry['value']} {entry.get('unit')}",
                entry.get("source", ""),
            )
        self.file.told[place, key] = Told(f"{place}.{key}", value, layer.place, source)
        return entry

    def scalars(self, **units: str) -> dict[str, Any]:
        """Return several numbers by name, each in its unit."""
        if missing := [key for key in units if key not in self]:
            raise self.file.missing(self.general, *missing)
        return TableReader.scalars(self, **units)
