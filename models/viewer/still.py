"""Still pictures of a page, taken by a browser without a window."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from urllib.parse import urlencode

from trussflow.blocks.framework.files import replaced
from trussflow.models.errors import ModelError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
DRAWN_BY = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Without a graphics card, and the same pixels on every machine."""
TIME_LIMIT = 120  # s


def browser() -> str | None:
    """Return the program that takes pictures: what BROWSER_PATH says, or the first found of `BROWSERS`."""
    return os.environ.get("BROWSER_PATH") or next(filter(None, map(shutil.which, BROWSERS)), None)


def still(
    page: str | Path,
    picture: str | Path,
    *,
    time: float,
    camera: str = "oblique",
    exaggeration: float | None = None,
    size: tuple[int, int] = (1200, 700),
) -> Path:
    """Take a picture of the truss from a page that `replay` wrote.

    Parameters
    ----------
    page : str or pathlib.Path
        The page.
    picture : str or pathlib.Path
        PNG file to write.
    time : float
        Instant shown [s].
    camera : str
        ``"oblique"``, ``"front"``, ``"side"`` or ``"top"``.
    exaggeration : float, optional
        Of the deformation, 1 to 500; by default the page's own [-].
    size : tuple of int
        Width and height [pixel].

    Returns
    -------
    pathlib.Path
        The picture.

    Raises
    ------
    ModelError
        If there is no such page, no Chromium or Chrome, or it takes no picture.
    """
    program, source = browser(), Path(page).resolve()
    if not source.is_file():
        raise ModelError(f"cannot take a picture of '{page}': there is no such file; replay writes it")
    if program is None:
        raise ModelError(
            "cannot take a picture: no Chromium or Chrome is found; install one (package chromium), or set "
            "BROWSER_PATH to its program"
        )
    asked = {"t": time, "camera": camera, "still": size[1]}
    if exaggeration is not None:
        asked["exaggeration"] = exaggeration
    try:
        with replaced(picture) as partial, tempfile.TemporaryDirectory() as profile:
            command = [
                program,
                "--headless",
                *DRAWN_BY,
                "--hide-scrollbars",
                "--disable-background-networking",
            ]
            command += [f"--user-data-dir={profile}", f"--window-size={size[0]},{size[1]}"]
            command += ["--virtual-time-budget=60000", f"--screenshot={partial}"]
            if hasattr(os, "geteuid") and os.geteuid() == 0:  # Chromium's own cage does not hold root
                command.append("--no-sandbox")
            done = subprocess.run(
                [*command, f"{source.as_uri()}#{urlencode(asked)}"],
                capture_output=True,
                text=True,
                timeout=TIME_LIMIT,
                check=False,
            )
            if not partial.is_file():
                raise ModelError(f"cannot take a picture with '{program}': {done.stderr.strip()[-500:]}")
    except (OSError, subprocess.SubprocessError) as error:
        raise ModelError(f"cannot take a picture with '{program}': {error}") from error
    return Path(picture)
