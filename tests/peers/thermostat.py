"""
A thermostat (PathSim)
======================

A room of 15 degrees outside, T' = a (15 - T) + H while the heater is on, between 23 and 25 degrees. Each
cycle is two exponentials. PathSim: ``example_thermostat.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Integrator, Relay, simulate

a, H = 0.45, 5.0
room = Diagram("room")
room.add(T=Integrator(15.0), heater=Relay(25.0, 23.0, on=0.0, off=H))
room.T >> room.heater
(a * (15.0 - room.T.y) + room.heater.y) >> room.T
# s, first and later
heating = np.log((H / a + 15 - np.array([15.0, 23.0])) / (H / a + 15 - 25)) / a
period = heating[1] + np.log(10 / 8) / a
duration = heating[0] + 6 * period
end = float(
    simulate(room, duration, solver="DOP853", rtol=1e-12, atol=1e-12)["T.y"][-1]
)
print(f"after six cycles of {period:.6f} s: {end:.9f} degrees")
assert abs(end - 25.0) < 1e-8
