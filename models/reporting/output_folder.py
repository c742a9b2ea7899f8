"""Output folders of commands."""

import tempfile
from pathlib import Path

from trussflow.models.errors import ModelError


def prepared_folder(folder: Path) -> Path:
    """Create the output folder, and check that files can be written there.

    Parameters
    ----------
    folder : pathlib.Path
        Output folder.

    Raises
    ------
    ModelError
        If the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ModelError(
            f"cannot write to the output folder '{folder}': {error}"
        ) from error
    return folder
