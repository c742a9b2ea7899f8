"""Still pictures of a page, by a headless browser."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlencode

from trussflow.blocks.support.files import replaced
from trussflow.models.errors import ModelError
from trussflow.models.validation import check_choice

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "msedge",
)
CAMERAS = ("oblique", "front", "side", "top")
TIME_LIMIT = 600  # s; for a browser that hangs, not for a slow one
PAGE_STATUS = re.compile(r'"This page (?:is shown|(cannot be shown: .*))", source')
"""Pattern of the page's status message in the log of the browser."""


def browser() -> str | None:
    """Return the browser: BROWSER_PATH, or the first installed one of `BROWSERS`."""
    return os.environ.get("BROWSER_PATH") or next(
        filter(None, map(shutil.which, BROWSERS)), None
    )


def launch_options() -> list[str]:
    """Return the options of the browser: software rendering, no background network access."""
    options = [
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--disable-background-networking",
    ]
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    return options + ["--no-sandbox"] * root  # the sandbox does not run as root


def still(
    page: str | Path,
    picture: str | Path,
    *,
    time: float | None = None,
    camera: str = "oblique",
    size: tuple[int, int] = (1200, 700),
) -> Path:
    """Take a picture of the truss from a page by `replay`.

    Parameters
    ----------
    page : str or pathlib.Path
        Page to show.
    picture : str or pathlib.Path
        PNG file to write.
    time : float, optional
        Instant shown [s]; by default the first.
    camera : str
        One of `CAMERAS`.
    size : tuple of int
        Width and height [pixel].

    Returns
    -------
    pathlib.Path
        Path of the picture.

    Raises
    ------
    ModelError
        If there is no such page, camera or instant, no Chromium or Chrome, or it cannot show the page.
    """
    with replaced(picture) as partial:
        options = ("--hide-scrollbars", f"--screenshot={partial}")
        asked = {"t": time, "still": size[1]}
        done = browsed(page, size, options, camera=camera, **asked)
        if not partial.is_file():
            raise ModelError(
                f"cannot take a picture of '{page}': {done.stderr.strip()[-500:]}"
            )
    return Path(picture)


def browsed(
    page: str | Path,
    size: tuple[int, int],
    options: Sequence[str],
    *,
    camera: str,
    **asked: object,
) -> subprocess.CompletedProcess[str]:
    """Show a page in a headless browser, and return the output of the browser.

    Parameters
    ----------
    page : str or pathlib.Path
        Page to show.
    size : tuple of int
        Width and height of the window [pixel].
    options : sequence of str
        Further options of the browser.
    camera : str
        One of `CAMERAS`.
    **asked : object
        Settings of the page; those that are None are omitted.

    Raises
    ------
    ModelError
        If there is no such page or camera, no Chromium or Chrome, or it cannot show the page.
    """
    check_choice("camera", camera, CAMERAS)
    program, source = browser(), Path(page).resolve()
    if not source.is_file():
        raise ModelError(
            f"cannot take a picture of '{page}': there is no such file; replay writes it"
        )
    if program is None:
        raise ModelError(
            "cannot take a picture: no Chromium or Chrome is found; install one (package chromium), or set "
            "BROWSER_PATH to its program"
        )
    settings = {key: value for key, value in asked.items() if value is not None}
    words = urlencode({"camera": camera} | settings)
    try:
        with tempfile.TemporaryDirectory() as profile:
            command = [
                program,
                "--headless",
                *launch_options(),
                f"--user-data-dir={profile}",
                f"--window-size={size[0]},{size[1]}",
                "--virtual-time-budget=60000",
                "--enable-logging=stderr",
                *options,
                f"{source.as_uri()}#{words}",
            ]
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=TIME_LIMIT, check=False
            )
    except (OSError, subprocess.SubprocessError) as error:
        raise ModelError(f"cannot take a picture with '{program}': {error}") from error
    status = PAGE_STATUS.search(done.stderr)
    if status is None or status[1]:
        # a browser also takes pictures of its error pages
        why = (
            "replay did not write it, or the browser failed"
            if status is None
            else f"it {status[1]}"
        )
        raise ModelError(f"cannot take a picture of '{page}': {why}")
    return done
