r"""Describing functions: what a nonlinearity does to a sinusoid of a chosen amplitude.

For a function f of several variables and a sinusoid of amplitude a in the j-th alone,

.. math:: N_j(a) = \frac{1}{\pi a}\int_0^{2\pi} f(z_0 + a \sin\varphi\, e_j)\sin\varphi\,d\varphi

is the gain of the first harmonic. It tends to the derivative as a goes to zero, where there
is one. Source: Gelb, Vander Velde (1968), *Multiple-Input Describing Functions and Nonlinear
System Design*, section 2.2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trussflow.blocks.support.types import Vector

SAMPLES_PER_PERIOD = 96
"""Points on one period. For |x|^0.9 the gain is then right to 2e-4, the error falling with the
power 1.9 of the number."""

SAMPLE_PHASES = 2 * np.pi * (np.arange(SAMPLES_PER_PERIOD) + 0.5) / SAMPLES_PER_PERIOD
"""Midpoints: none is where a sine or cosine is zero."""


def columns(
    function: Callable[[Vector], Vector], point: Vector, amplitudes: dict[int, float]
) -> dict[int, Vector]:
    """Return the describing functions of a function for one variable after the other.

    Parameters
    ----------
    function : callable
        Maps a vector to a vector.
    point : Vector
        The point around which the variables oscillate [any].
    amplitudes : dict of int to float
        Amplitude of each variable wanted, by its number [unit of the variable].

    Returns
    -------
    dict of int to Vector
        Gains from that variable to all values.
    """
    found = {}
    for number, amplitude in amplitudes.items():
        total: Vector | float = 0.0
        for sine in np.sin(SAMPLE_PHASES):
            moved = point.copy()
            moved[number] += amplitude * sine
            total = total + sine * function(moved)
        found[number] = np.asarray(2 * total / (SAMPLES_PER_PERIOD * amplitude))
    return found
