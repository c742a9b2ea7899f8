"""Where commands write."""

import tempfile
from pathlib import Path

from trussflow.models.errors import ModelError


def prepared_folder(folder: Path) -> Path:
    """Create the output folder and make sure that it can be written, before anything runs.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.

    Raises
    ------
    ModelError
        If it cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ModelError(f"cannot write to the output folder '{folder}': {error}") from error
    return folder
