"""
A delta-sigma converter (PathSim)
=================================

An integrator sums the difference of signal and bits; a comparator at 100 Hz makes the bits, +1 or -1. The sum
of the bits differs from that of the signal by at most two. PathSim:
``example_deltasigma.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Integrator, Sine, as_block, simulate


@as_block(sample_time=0.01)
def comparator(x):
    """Return a bit."""
    return np.where(x >= 0, 1.0, -1.0)


converter = Diagram("converter")
source, rest = converter.add(source=Sine(0.9, 1.0), rest=Integrator())
bits = comparator(rest)
source.y - bits.y >> rest
result = simulate(converter, 20.0, step=1e-3, log_step=0.01)
signal = 0.9 * (1 - np.cos(2 * np.pi * result["time"])) / (2 * np.pi)
difference = 0.01 * result["comparator_1.y"][:-1].cumsum().values - signal[1:]
print(
    f"largest difference of the sums, in bits: {float(abs(difference).max()) / 0.01:.3f}"
)
assert np.allclose(-difference, result["rest.y"][1:], rtol=0.0, atol=1e-9)
assert abs(difference).max() < 0.02
