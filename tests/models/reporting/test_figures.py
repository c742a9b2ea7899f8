"""Figures of curves: what is written can be told apart."""

import numpy as np
from PIL import Image

from trussflow.models.reporting.figures import COLOURS, Curve, Panel, drawing, save

# Of the three parts of a colour, together, of 255 each: less than an eye sees between two curves.
UNSEEN = 8


def test_curves_of_a_small_file_keep_their_colours(tmp_path):
    x = np.linspace(0.0, 1.0, 100)
    curves = [Curve(f"curve {k}", x, x ** (k + 1)) for k in range(len(COLOURS))]
    save(
        drawing([Panel(curves=curves, y="y [-]")]), tmp_path / "figure.png", small=True
    )
    pixels = (
        np.asarray(Image.open(tmp_path / "figure.png").convert("RGB"))
        .reshape(-1, 3)
        .astype(int)
    )
    assert pixels[0].tolist() == [255, 255, 255]
    for colour in COLOURS:
        wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
        assert abs(pixels - wanted).sum(axis=1).min() <= UNSEEN
