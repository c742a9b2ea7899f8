"""
Two clocks (bdsim)
==================

A sine of 0.2 Hz is sampled at 2 Hz and at 3 Hz, and the mean of both is taken, which changes at instants of
both. bdsim: ``multi-clock.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Sine, ZeroOrderHold, simulate

sampler = Diagram("sampler")
sine, two, three = sampler.add(
    sine=Sine(1.0, 0.2), two=ZeroOrderHold(1 / 2), three=ZeroOrderHold(1 / 3)
)
sine >> two
sine >> three
mean = 0.5 * (two.y + three.y)
sampler.expose(mean=mean)
result = simulate(sampler, 5.0, step=1 / 60, log=["mean"])
tick = np.arange(result.time.size)
exact = [np.sin(0.4 * np.pi * (tick // each) * each / 60) for each in (30, 20)]
error = float(abs(result["mean"] - np.mean(exact, axis=0)).max())
print(f"largest error {error:.1e}")
assert error < 1e-12
