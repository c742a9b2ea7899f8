"""File format of modal data: JSON, one key per array, units in the keys.

================================ ========= =====================================================
key                              shape     meaning
================================ ========= =====================================================
format                           text      always ``"trussflow truss modes 1"``
source                           text      origin of the data
position_m                       (n, 3)    point masses, undeformed, in the truss frame
mass_kg                          (n,)      masses of these points
shape_per_sqrt_kg                (n, 3, h) mass-normalized mode shapes at these points
frequency_hz                     (h,)      natural frequencies
damping_ratio                    (h,)      damping ratios
grasp_position_m                 (k, 3)    grasp points, undeformed
grasp_translation_per_sqrt_kg    (k, 3, h) mode shapes at the grasp points
grasp_rotation_rad_per_sqrt_kg_m (k, 3, h) rotations of the modes at the grasp points
================================ ========= =====================================================
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trussflow.blocks.support.files import reading, replaced
from trussflow.models.errors import ModelError

FILE_FORMAT = "trussflow truss modes 1"

_KEYS = {
    "source": "source",
    "position_m": "positions",
    "mass_kg": "masses",
    "shape_per_sqrt_kg": "shapes",
    "frequency_hz": "frequencies",
    "damping_ratio": "damping_ratios",
    "grasp_position_m": "grasp_positions",
    "grasp_translation_per_sqrt_kg": "grasp_translations",
    "grasp_rotation_rad_per_sqrt_kg_m": "grasp_rotations",
}


def read_modes(path: str | Path) -> dict[str, Any]:
    """Read modal data from a JSON file.

    Parameters
    ----------
    path : str or pathlib.Path
        File in the format of this module.

    Returns
    -------
    dict
        Arguments of `trussflow.models.truss.truss_modes.TrussModes`, unchecked.

    Raises
    ------
    ModelError
        If the file cannot be read, is not JSON of this format, or has unknown or missing keys.
    """
    cannot = "cannot read truss modes from"
    problem = f"{cannot} '{path}'"
    with reading(path, ModelError, cannot, "it is not JSON ({})") as file:
        content = json.loads(file.read_text(encoding="utf-8"))
    if not isinstance(content, dict) or content.pop("format", None) != FILE_FORMAT:
        raise ModelError(
            f"{problem}: it must be an object with 'format': {FILE_FORMAT!r}"
        )
    differences = {"unknown": content.keys() - _KEYS, "missing": _KEYS.keys() - content}
    for kind, keys in differences.items():
        if keys:
            raise ModelError(f"{problem}: {kind} keys {sorted(keys)}")
    return {name: content[key] for key, name in _KEYS.items()}


def write_modes(values: Mapping[str, Any], path: str | Path) -> None:
    """Write modal data to a JSON file; `read_modes` returns exactly the same data.

    Parameters
    ----------
    values : mapping
        Arguments of `trussflow.models.truss.truss_modes.TrussModes`.
    path : str or pathlib.Path
        An existing file is replaced.
    """
    content: dict[str, Any] = {"format": FILE_FORMAT}
    for key, name in _KEYS.items():
        value = values[name]
        content[key] = value if isinstance(value, str) else np.asarray(value).tolist()
    lines = [
        f"{json.dumps(k)}: {json.dumps(v, separators=(',', ':'))}"
        for k, v in content.items()
    ]
    with replaced(path) as partial:
        partial.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
