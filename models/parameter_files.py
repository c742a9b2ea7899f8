"""Reading parameter files: TOML in which every value states its unit and its source.

A value is written ``mass = {value = 0.99, unit = "kg", source = "paper, Table 2"}``. The
reader says what unit it expects, so a file in other units is refused, not misread.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from trussflow.blocks.framework.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.validation import frozen_array


def shipped_file(name: str) -> Path:
    """Return the path of a parameter file that comes with the package.

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
        If there is no such file; the message lists those there are.
    """
    folder = Path(str(files("trussflow.models"))) / "parameters"
    path = folder / name
    if not path.is_file():
        there = ", ".join(sorted(p.name for p in folder.iterdir() if p.suffix in (".toml", ".json")))
        raise ModelError(f"no parameter file {name!r} comes with trussflow; there are: {there}")
    return path


@dataclass(frozen=True, slots=True)
class ParameterTable:
    """One table of a parameter file, with the place it was found for error messages.

    Attributes
    ----------
    content : mapping
        The table as TOML gave it.
    place : str
        File and table, for example ``robot_arm_literal.toml, base``.
    """

    content: Mapping[str, Any]
    place: str

    @classmethod
    def read(cls, path: str | Path) -> ParameterTable:
        """Read a whole parameter file.

        Parameters
        ----------
        path : str or pathlib.Path
            A TOML file.

        Returns
        -------
        ParameterTable

        Raises
        ------
        ModelError
            If the file does not exist or is not TOML.
        """
        path = Path(path)
        try:
            with path.open("rb") as file:
                return cls(tomllib.load(file), path.name)
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) else f"it is not TOML ({error})"
            raise ModelError(f"cannot read parameter file {str(path)!r}: {why}") from error

    @classmethod
    def shipped(cls, name: str) -> ParameterTable:
        """Read a parameter file that comes with the package; see `shipped_file`."""
        return cls.read(shipped_file(name))

    def table(self, key: str) -> ParameterTable:
        """Return a sub-table.

        Parameters
        ----------
        key : str
            Its name.

        Returns
        -------
        ParameterTable

        Raises
        ------
        ModelError
            If there is no table of that name.
        """
        found = self._find(key)
        if not isinstance(found, Mapping):
            raise ModelError(f"{self.place}: {key!r} must be a table")
        return ParameterTable(found, f"{self.place}, {key}")

    def tables(self, key: str) -> list[ParameterTable]:
        """Return the tables of an array of tables, each headed ``[[key]]``.

        Parameters
        ----------
        key : str
            The name in the double brackets.

        Returns
        -------
        list of ParameterTable

        Raises
        ------
        ModelError
            If there is no array of tables of that name.
        """
        found = self._find(key)
        if not isinstance(found, list) or not all(isinstance(t, Mapping) for t in found):
            raise ModelError(f"{self.place}: {key!r} must be an array of tables, each headed [[{key}]]")
        return [ParameterTable(t, f"{self.place}, {key}[{i}]") for i, t in enumerate(found)]

    def listed(self) -> list[tuple[str, ...]]:
        """Return place, value, unit and source of each value here and in the tables below, as text."""
        found: list[tuple[str, ...]] = []
        for key, entry in self.content.items():
            if isinstance(entry, Mapping) and "value" in entry:
                found.append((f"{self.place}, {key}", *(str(entry[k]) for k in ("value", "unit", "source"))))
            elif isinstance(entry, Mapping | list):
                below = [self.table(key)] if isinstance(entry, Mapping) else self.tables(key)
                found += [row for table in below for row in table.listed()]
        return found

    def text(self, key: str) -> str:
        """Return a plain text.

        Parameters
        ----------
        key : str
            Its name.

        Returns
        -------
        str

        Raises
        ------
        ModelError
            If it is missing or not text.
        """
        found = self._find(key)
        if not isinstance(found, str):
            raise ModelError(f"{self.place}: {key!r} must be text in quotes, got {found!r}")
        return found

    def scalar(self, key: str, unit: str) -> float:
        """Return a number.

        Parameters
        ----------
        key : str
            Name of the value.
        unit : str
            The unit it must be given in, for example ``"kg"``.

        Returns
        -------
        float

        Raises
        ------
        ModelError
            If it is missing, lacks value, unit or source, has another unit, or is no number.
        """
        return float(self.array(key, unit, ()))

    def scalars(self, **units: str) -> dict[str, Any]:
        """Return several numbers by name, each with the unit it must be given in."""
        return {key: self.scalar(key, unit) for key, unit in units.items()}

    def array(self, key: str, unit: str, shape: tuple[int | None, ...]) -> Vector:
        """Return an array of numbers.

        Parameters
        ----------
        key : str
            Name of the value.
        unit : str
            The unit it must be given in, for example ``"kg*m^2"``.
        shape : tuple of int or None
            Wanted shape; None stands for any length.

        Returns
        -------
        array

        Raises
        ------
        ModelError
            If it is missing, lacks value, unit or source, has another unit or shape, or is
            not made of finite numbers.
        """
        entry = self._find(key)
        if not isinstance(entry, Mapping):
            raise ModelError(f"{self.place}: {key!r} must read {{value = ..., unit = ..., source = ...}}")
        for part in ("value", "unit", "source"):
            if part not in entry:
                raise ModelError(
                    f"{self.place}: {key!r} has no {part!r}; each value states value, unit, source"
                )
        if entry["unit"] != unit:
            raise ModelError(f"{self.place}: {key!r} is given in {entry['unit']!r}; it must be in {unit!r}")
        return frozen_array(f"{self.place}: {key!r}", entry["value"], shape)

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def _find(self, key: str) -> Any:
        if key not in self.content:
            there = ", ".join(self.content) or "nothing"
            raise ModelError(f"{self.place}: {key!r} is missing; found {there}")
        return self.content[key]
