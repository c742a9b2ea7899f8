"""An FMU on disk, looked into but not unpacked."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trussflow.blocks.framework.validation import as_path
from trussflow.fmu.errors import FmuArchiveError, FmuBinaryError, FmuDescriptionError, FmuError
from trussflow.fmu.runtime.archive import DESCRIPTION, MAX_BYTES, read_description
from trussflow.fmu.runtime.description import FmuDescription, Kind, parse_description
from trussflow.fmu.runtime.library import binary_path


@dataclass(frozen=True, slots=True)
class FmuFile:
    """An FMU on disk, looked into but not unpacked.

    Attributes
    ----------
    path : pathlib.Path
        Where it is.
    description : FmuDescription
        Its model description.
    files : frozenset of str
        The names of the files in it.
    digest : str
        What tells its model description from others.
    max_bytes : float
        Unpacked size allowed [B].
    """

    path: Path
    description: FmuDescription
    files: frozenset[str]
    digest: str
    max_bytes: float = MAX_BYTES

    @classmethod
    def read(cls, path: str | Path, max_bytes: float = MAX_BYTES) -> FmuFile:
        """Look into an FMU.

        Parameters
        ----------
        path : str or pathlib.Path
            The FMU.
        max_bytes : float
            Unpacked size allowed [B].

        Raises
        ------
        FmuArchiveError
            If it is no archive, or unpacking it would do harm.
        FmuDescriptionError
            If its model description is broken or hostile.
        """
        path = as_path(FmuArchiveError, "cannot open the FMU", path).absolute()
        text, files = read_description(path, max_bytes)
        description = parse_description(text, f"the model description of '{path.name}'")
        return cls(path, description, files, hashlib.sha256(text).hexdigest(), max_bytes)

    def check_unchanged(self, folder: Path) -> None:
        """Refuse an FMU that was written anew since it was looked into.

        Parameters
        ----------
        folder : pathlib.Path
            Where it was unpacked.

        Raises
        ------
        FmuError
            If its model description is another one now.
        """
        text = (folder / DESCRIPTION).read_bytes()
        if hashlib.sha256(text).hexdigest() != self.digest:
            raise FmuError(
                f"FMU '{self.path.name}' was written anew since it was read, so its variables may "
                "be others; build a new block of it"
            )

    def kind(self, wanted: str | None = None) -> Kind:
        """Return the kind to use: the one wanted, else co-simulation if there is a choice.

        Parameters
        ----------
        wanted : str or None
            ``"cs"``, ``"me"`` or None.

        Raises
        ------
        FmuError
            If the FMU is not of the kind wanted.
        FmuDescriptionError
            If its description does not suffice for that kind.
        FmuBinaryError
            If it has no binary for this machine.
        """
        kinds = self.description.kinds
        kind: Any = next(iter(kinds)) if wanted is None else wanted
        if str(kind) not in kinds:
            raise FmuError(
                f"FMU '{self.path.name}' offers {' and '.join(kinds)}, not '{kind}' "
                "(cs: co-simulation, me: model exchange)"
            )
        if kind == "me" and (name := self.description.stateless):
            raise FmuDescriptionError(
                f"cannot use FMU '{self.path.name}' for model exchange: '{name}' is listed as a derivative "
                "of a state, but does not say of which"
            )
        needed = binary_path(self.description, kind)
        if needed not in self.files:
            parts = (f.split("/") for f in self.files if f.startswith("binaries/"))
            has_sources = any(f.startswith("sources/") and f.endswith(".c") for f in self.files)
            there = sorted({p[1] for p in parts if len(p) > 2})
            raise FmuBinaryError(
                f"FMU '{self.path.name}' has no binary for this machine ('{needed}'); it has: "
                f"{', '.join(there) or 'none'}"
                + ("; its sources can be built with 'fmpy compile'" if has_sources else "")
            )
        return kind  # type: ignore[no-any-return]
