"""What a report rests on, beside it: every number, the runs, and the code that made them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from study_tools.cache import code_digest, libraries, write_atomically
from study_tools.ledger import Ledger
from trussflow.blocks.framework.files import reading
from trussflow.models.errors import ModelError

EVIDENCE = "evidence.json"


def write_evidence(folder: Path, ledger: Ledger, more: Mapping[str, Any]) -> None:
    """Write the evidence of a report: digest of the code, libraries, numbers.

    Parameters
    ----------
    folder : pathlib.Path
        Of the report.
    ledger : Ledger
        All its numbers.
    more : mapping
        What else there is, such as the runs.
    """
    evidence = {
        "code": {"digest": code_digest(), "libraries": libraries()},
        **more,
        "numbers": {name: asdict(number) for name, number in ledger.numbers.items()},
    }
    write_atomically(folder / EVIDENCE, json.dumps(evidence, indent=1) + "\n")


def is_fresh(folder: Path, command: str) -> tuple[bool, str]:
    """Tell whether a report was made by the code at hand, and say so in a sentence.

    Parameters
    ----------
    folder : pathlib.Path
        Of the report.
    command : str
        What makes it.

    Raises
    ------
    ModelError
        If there is no report.
    """
    with reading(folder / EVIDENCE, ModelError, "cannot read the evidence of a report in") as file:
        evidence = json.loads(file.read_text(encoding="utf-8"))
    digest, maker = code_digest(), evidence.get("code", {}).get("digest", "not stated")
    if maker == digest:
        return True, f"the report in '{folder}' was made by this code, digest {digest}"
    return False, (
        f"the report in '{folder}' is old: it was made by other code (digest {maker}; of this code it "
        f"is {digest}). Run '{command}'."
    )
