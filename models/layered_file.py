"""Parameter files that extend others: what one does not say is as in the next; values keep their place."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

from trussflow.blocks.framework.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.parameter_files import ParameterTable, shipped_file

EXTENDS = "extends"
"""Names the next file: one beside this one, or a shipped one."""


class Told(NamedTuple):
    """One value as it was read.

    Attributes
    ----------
    key : str
        Table and key.
    value : str
        As written.
    place : str
        The file that says so.
    source : str
        Its source; empty where none is given.
    """

    key: str
    value: str
    place: str
    source: str


_PLACED, _QUOTED = re.compile(r"\[|[-.\w]+\.(toml|urdf)\b"), re.compile(r"'[^']*'")


@dataclass(slots=True)
class LayeredFile:
    """A parameter file and those that it extends, the first that says something counts.

    Attributes
    ----------
    layers : list of ParameterTable
        Whole files.
    folder : pathlib.Path
        Of the first; files that it names are there.
    told : dict
        What was read so far, by table and key.
    known : set
        What was asked for so far, table and key.
    """

    layers: list[ParameterTable]
    folder: Path = Path()
    told: dict[tuple[str, str], Told] = field(default_factory=dict)
    known: set[tuple[str, str]] = field(default_factory=set)

    @classmethod
    def read(
        cls, path: str | Path, before: Iterable[ParameterTable] = (), otherwise: str = ""
    ) -> LayeredFile:
        """Read a file, and those that it extends.

        Parameters
        ----------
        path : str or pathlib.Path
            A TOML file.
        before : iterable of ParameterTable
            What counts more, such as what a command line says.
        otherwise : str
            What the file extends if it does not say; by default nothing.

        Raises
        ------
        ModelError
            If a file cannot be read, or extends itself by others.
        """
        layers, seen, place = list(before), [], Path(path)
        while True:
            if place.resolve() in seen:
                raise ModelError(f"{Path(path).name}: {EXTENDS!r} leads back to {place.name}")
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
                raise layers[-1].error(EXTENDS, f"leads nowhere: {error}") from error

    def table(self, name: str) -> LayeredTable:
        """Return a table: what all files say under that `name`."""
        return LayeredTable(self, name)

    def named(self, key: str) -> str:
        """Return a text under a `key` in no table."""
        layer = next((layer for layer in self.layers if key in layer), self.layers[0])
        return layer.text(key)

    def read_first(self, table: str, key: str, read: Callable[[ParameterTable], Any]) -> Any:
        """Return what the first layer that has the `key` in its `table` says to `read`."""
        layer = self.layer_of(table, key)
        if layer is None:
            places = ", ".join(layer.place for layer in self.layers if layer.content)
            for each in self.layers:  # a word misspelt is the likeliest reason
                keys = each.table(table).content if table in each else ()
                unknown = [k for k in keys if (table, k) not in self.known]
                if near := difflib.get_close_matches(key, unknown, 1):
                    raise each.table(table).error(near[0], f"means nothing here; did you mean {key!r}?")
            raise ModelError(f"[{table}] says no {key!r}, neither in {places}")
        own = layer.table(table)
        value, entry = read(own), own.content[key]
        source = entry["source"] if isinstance(entry, dict) else ""
        shown = f"{entry['value']} {entry['unit']}" if isinstance(entry, dict) else str(entry)
        self.told[table, key] = Told(f"{table}.{key}", shown, layer.place, source)
        return value

    def layer_of(self, table: str, key: str) -> ParameterTable | None:
        """Return the first file that has a `key` in its `table`, if there is one."""
        self.known.add((table, key))
        return next((each for each in self.layers if table in each and key in each.table(table)), None)

    @contextmanager
    def blamed(self, table: str = "", key: str = "") -> Iterator[None]:
        """Have errors that begin with no file say where the key is that they speak of, by default `key`.

        It is one of this `table`, or of one that the error itself names.
        """
        try:
            yield
        except ModelError as error:
            said = str(error)
            if _PLACED.match(said) or any(said.startswith(layer.place) for layer in self.layers):
                raise
            words = _QUOTED.sub("", said)
            found = [
                (-len(k), at.start(), t, k)
                for t, k in self.told
                if (t == table or f"{t}:" in words) and (at := re.search(rf"\b{k.removesuffix('s')}", words))
            ]
            if not (found or key):
                raise
            *_, table, key = min(found, default=(table, key))
            raise self.table(table).error(key, f"is refused: {said}") from error

    def refuse_others(self) -> None:
        """Refuse what nobody has read.

        Raises
        ------
        ModelError
            If a file has a table or key that means nothing; it says which there are.
        """
        tables = sorted({table for table, _ in self.known})
        for layer in self.layers:
            for name, content in layer.content.items():
                if name in (EXTENDS, "title"):
                    continue
                if name not in tables:
                    raise layer.error(name, f"is no table of a mission; there are {', '.join(tables)}")
                keys = sorted(key for table, key in self.known if table == name)
                for key in content:
                    if key not in keys:
                        near = difflib.get_close_matches(key, keys, 1)
                        hint = f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(keys)}"
                        raise layer.table(name).error(key, f"means nothing here{hint}")


@dataclass(frozen=True, slots=True)
class LayeredTable:
    """One table of a `LayeredFile`, read as a `ParameterTable` is; see there for the methods.

    Attributes
    ----------
    file : LayeredFile
        Where it is.
    name : str
        Its name.
    """

    file: LayeredFile
    name: str

    def __contains__(self, key: str) -> bool:
        return self.file.layer_of(self.name, key) is not None

    def error(self, key: str, what: str) -> ModelError:
        """Return an error about a `key`, with its file and line; `what` is wrong with it."""
        layer = self.file.layer_of(self.name, key)
        return (layer.table(self.name) if layer else self.file.layers[0]).error(key, what)

    def says(self, key: str, word: str) -> bool:
        """Tell whether a `key` is that `word`."""
        return cast(bool, self.file.read_first(self.name, key, lambda table: table.content[key] == word))

    def text(self, key: str) -> str:
        """Return the text of a `key`."""
        return cast(str, self.file.read_first(self.name, key, lambda table: table.text(key)))

    def choice(self, key: str, choices: Iterable[str]) -> str:
        """Return one of several words, by its `key`; `choices` are what it may be."""
        return cast(str, self.file.read_first(self.name, key, lambda table: table.choice(key, choices)))

    def texts(self, key: str) -> list[str]:
        """Return the text of a `key`, or several of them, as a list."""
        return cast("list[str]", self.file.read_first(self.name, key, lambda table: table.texts(key)))

    def rows(self, key: str) -> list[list[int]]:
        """Return rows of whole numbers of a `key`."""
        return cast("list[list[int]]", self.file.read_first(self.name, key, lambda table: table.rows(key)))

    def whole(self, key: str) -> int:
        """Return the whole number of a `key`."""
        return cast(int, self.file.read_first(self.name, key, lambda table: table.whole(key)))

    def scalar(self, key: str, unit: str) -> float:
        """Return the number of a `key`, in its `unit`."""
        return cast(float, self.file.read_first(self.name, key, lambda table: table.scalar(key, unit)))

    def scalars(self, **units: str) -> dict[str, Any]:
        """Return several numbers by name, each in its unit."""
        return {key: self.scalar(key, unit) for key, unit in units.items()}

    def array(self, key: str, unit: str, shape: tuple[int | None, ...]) -> Vector:
        """Return the numbers of a `key`, in their `unit` and of that `shape`."""
        return cast(
            "Vector", self.file.read_first(self.name, key, lambda table: table.array(key, unit, shape))
        )
