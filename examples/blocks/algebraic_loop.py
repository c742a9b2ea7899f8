"""
Algebraic loops, solved
=======================

A battery of 28 V with an internal resistance of 0.5 ohm feeds a load of constant power. Current and voltage
depend on each other at the same instant, so the equations are solved at every instant.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Diagram, Function, Input, Output, Ramp, linearize, simulate
from trussflow.blocks.errors import DivergenceError

bus = Diagram("power bus", loops="solve")
power, load, battery = bus.add(
    power=Ramp(20.0, unit="W"),
    load=Function(
        lambda power, v: power / v,
        {"power": Input(), "v": Input(unit="V")},
        {"i": Output(unit="A")},
    ),
    battery=Function(
        lambda i: 28.0 - 0.5 * i, {"i": Input(unit="A")}, {"v": Output(unit="V")}
    ),
)
power >> load.power
load >> battery
battery >> load.v
bus.guess(battery.v, 28.0)  # there is a second solution, near zero volts

result = simulate(bus, 19.5, step=0.1)
exact = 14.0 + np.sqrt(196.0 - 0.5 * result["power.y"])
print(f"largest error: {float(abs(result['battery.v'] - exact).max()):.1e} V")
plt.plot(result["time"], result["battery.v"])
plt.xlabel("time [s]")
plt.ylabel("voltage of the bus [V]")
plt.show()

# %%
# The battery gives at most 28² / (4 · 0.5) = 392 W. Beyond, there is no solution; the error states the loop:

try:
    simulate(bus, 25.0, step=0.1)
except DivergenceError as problem:
    print(problem)

# %%
# Linear models differentiate through the loop by the implicit function theorem: each watt lowers the voltage
# by 0.25 / (v - 14) V, that is 1/56 V at no load.

bus.expose(volts=battery.v)
print(linearize(bus, inputs=[load.power]).D * 56.0)
