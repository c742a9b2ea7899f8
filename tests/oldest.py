"""Print the oldest versions that pyproject.toml allows, one pin a line, for ``make test-oldest``."""

import re
import sys
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"
BOUNDED = re.compile(r"([A-Za-z0-9._-]+)>=([0-9.]+)(; .*)?")
"""Name, version, and on which machines."""


def pins():
    """Return ``name==version``, or ``name==version; where``, for what trussflow and its tests depend on."""
    project = tomllib.loads(PYPROJECT.read_text())["project"]
    found = []
    for requirement in (
        *project["dependencies"],
        *project["optional-dependencies"]["test"],
    ):
        bound = BOUNDED.fullmatch(requirement)
        if bound is None:
            raise SystemExit(
                f"pyproject.toml: '{requirement}' names no oldest version; write name>=version"
            )
        found.append(f"{bound[1]}=={bound[2]}{bound[3] or ''}")
    return found


if __name__ == "__main__":
    sys.stdout.write("\n".join(pins()) + "\n")
