"""An FMU file, read and checked without unpacking it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trussflow.blocks.support.validation import as_path
from trussflow.fmu.errors import (
    FmuArchiveError,
    FmuBinaryError,
    FmuDescriptionError,
    FmuError,
)
from trussflow.fmu.runtime.archive import DESCRIPTION_FILE, read_description
from trussflow.fmu.runtime.description import FmuDescription, Kind, parse_description
from trussflow.fmu.runtime.library import binary_path


@dataclass(frozen=True, slots=True)
class FmuFile:
    """An FMU file, read and checked without unpacking it.

    Attributes
    ----------
    path : pathlib.Path
        Path of the file.
    description : FmuDescription
        Its model description.
    files : frozenset of str
        Names of the files in the archive.
    digest : str
        SHA-256 digest of the model description.
    """

    path: Path
    description: FmuDescription
    files: frozenset[str]
    digest: str

    @classmethod
    def read(cls, path: str | Path) -> FmuFile:
        """Read an FMU file.

        Parameters
        ----------
        path : str or pathlib.Path
            The FMU.

        Raises
        ------
        FmuArchiveError
            If the file is not a zip archive, or unpacking it would be unsafe.
        FmuDescriptionError
            If the model description is invalid or unsafe.
        """
        path = as_path(FmuArchiveError, "cannot open the FMU", path).absolute()
        text, files = read_description(path)
        description = parse_description(text, f"the model description of '{path.name}'")
        return cls(path, description, files, hashlib.sha256(text).hexdigest())

    def check_unchanged(self, folder: Path) -> None:
        """Raise an error if the FMU file was changed since it was read.

        Parameters
        ----------
        folder : pathlib.Path
            Folder of the unpacked FMU.

        Raises
        ------
        FmuError
            If the model description differs.
        """
        text = (folder / DESCRIPTION_FILE).read_bytes()
        if hashlib.sha256(text).hexdigest() != self.digest:
            raise FmuError(
                f"FMU '{self.path.name}' was changed since it was read, so its variables may "
                "differ; create a new block from it"
            )

    def kind(self, wanted: str | None = None) -> Kind:
        """Return the kind to use: `wanted` if given, else co-simulation if the FMU offers both.

        Parameters
        ----------
        wanted : str or None
            ``"cs"``, ``"me"`` or None.

        Raises
        ------
        FmuError
            If the FMU does not offer the wanted kind.
        FmuDescriptionError
            If the model description is incomplete for that kind.
        FmuBinaryError
            If the FMU has no binary for this machine.
        """
        kinds = self.description.kinds
        # `kinds` lists co-simulation first.
        kind: Any = next(iter(kinds)) if wanted is None else wanted
        if str(kind) not in kinds:
            raise FmuError(
                f"FMU '{self.path.name}' offers {' and '.join(kinds)}, not '{kind}' "
                "(cs: co-simulation, me: model exchange)"
            )
        if kind == "me" and (name := self.description.stateless):
            raise FmuDescriptionError(
                f"cannot use FMU '{self.path.name}' for model exchange: '{name}' is listed as a derivative "
                "of a state, but its state is not stated"
            )
        needed = binary_path(self.description, kind)
        if needed not in self.files:
            parts = (f.split("/") for f in self.files if f.startswith("binaries/"))
            there = sorted({p[1] for p in parts if len(p) > 2})
            raise FmuBinaryError(
                f"FMU '{self.path.name}' has no binary for this machine ('{needed}'); it has: "
                f"{', '.join(there) or 'none'}; 'fmpy compile' builds its sources, if it has any"
            )
        return kind  # type: ignore[no-any-return]
