"""
Limits: saturation, dead zone, rate limit, quantizer
====================================================

The effect of common actuator and converter limits on a sine of amplitude one. Colours show sample times.
"""

import matplotlib.pyplot as plt

from trussflow.blocks import DeadZone, Diagram, Quantizer, RateLimiter, Saturation, Sine, simulate

bench = Diagram("limits")
wave = bench.add(wave=Sine(1.0, frequency=0.5))
for block in bench.add(
    saturation=Saturation(-0.6, 0.6),
    dead_zone=DeadZone(-0.4, 0.4),
    rate_limiter=RateLimiter(2.0, 0.01),
    quantizer=Quantizer(0.25, 0.05, hysteresis=0.1),
):
    wave.y >> block.u
bench.draw("limits.svg")

# %%
result = simulate(bench, 4.0, step=1e-3)
figure, axes = plt.subplots(2, 2, sharex=True, sharey=True, layout="constrained")
for axis, name in zip(axes.flat, ("saturation", "dead_zone", "rate_limiter", "quantizer"), strict=True):
    axis.plot(result["time"], result["wave.y"], color="lightgrey")
    axis.plot(result["time"], result[f"{name}.y"])
    axis.set(title=name.replace("_", " "))
figure.supxlabel("time [s]")
plt.show()
