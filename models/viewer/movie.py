"""Films of a page, from frames by a headless browser."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path

from trussflow.blocks.support.files import replaced
from trussflow.models.errors import ModelError
from trussflow.models.validation import check_number
from trussflow.models.viewer.still import browsed

FRAME_RATE = 15.0  # 1/s
GIF_COLOURS = 128
"""Number of colours of an animated GIF [-]."""
WINDOW = 1200, 700
"""Size of the window of the browser; the frames have their own [pixel]."""
FRAME = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=]+)")


def movie(
    page: str | Path,
    path: str | Path,
    *,
    duration: float = 8.0,
    camera: str = "oblique",
    size: tuple[int, int] = (800, 450),
) -> Path:
    """Write a film of the truss from a page by `replay`.

    Parameters
    ----------
    page : str or pathlib.Path
        Page to show.
    path : str or pathlib.Path
        File to write, an animated ``.gif``.
    duration : float
        Duration of the film, at 15 frames per second [s].
    camera : str
        One of `CAMERAS`.
    size : tuple of int
        Width and height [pixel].

    Returns
    -------
    pathlib.Path
        Path of the film.

    Raises
    ------
    ModelError
        If the file has another suffix, or `still` would raise.
    """
    if Path(path).suffix.lower() != ".gif":
        raise ModelError(f"cannot write the film '{path}': its name must end in .gif")
    check_number("movie", duration=duration)
    count = max(2, round(duration * FRAME_RATE))
    text = browsed(
        page, WINDOW, ["--dump-dom"], camera=camera, film=f"{count},{size[0]},{size[1]}"
    ).stdout
    frames = [base64.b64decode(found[1]) for found in FRAME.finditer(text)]
    if len(frames) != count:
        raise ModelError(
            f"cannot write the film '{path}': the browser returned {len(frames)} of {count} frames"
        )
    with replaced(path) as partial:
        partial.write_bytes(_animated(frames))
    return Path(path)


def _animated(frames: list[bytes]) -> bytes:
    """Return frames as an animated GIF."""
    from PIL import Image

    # A median cut, the default, would mix the colours of robots.
    first, *others = [
        Image.open(io.BytesIO(frame))
        .convert("RGB")
        .quantize(GIF_COLOURS, Image.Quantize.FASTOCTREE)
        for frame in frames
    ]
    raw, pause = io.BytesIO(), round(1000.0 / FRAME_RATE)
    first.save(raw, "gif", save_all=True, append_images=others, duration=pause, loop=0)
    return raw.getvalue()
