"""
Cruise control on a hill (python-control)
=========================================

A car of 1600 kg in fourth gear at 20 m/s meets a slope of six degrees, too steep for its motor: the
throttle is full, and the integral does not wind up. Behind it the slope is four degrees; finally the
throttle balances the forces. python-control: ``cruise-control.py``.
"""

import numpy as np

from trussflow.blocks import (
    PID,
    Constant,
    Diagram,
    Integrator,
    TimeTable,
    as_block,
    simulate,
)

m, g, gear, wanted = 1600.0, 9.8, 12.0, 20.0


def thrust(v):
    """Return the force of the motor at full throttle [N]."""
    return gear * 190.0 * (1 - 0.4 * (gear * v / 420.0 - 1) ** 2)


def resistance(v, slope):
    """Return the force against the car [N]."""
    return m * g * (
        np.sin(slope) + 0.01 * np.sign(v)
    ) + 0.5 * 1.3 * 0.32 * 2.4 * v * np.abs(v)


@as_block
def car(throttle, v, slope):
    """Return the acceleration [m/s²]."""
    return (throttle * thrust(v) - resistance(v, slope)) / m


cruise, hill = Diagram("cruise"), np.radians([0.0, 0.0, 6.0, 6.0, 4.0, 4.0])
goal, slope, v = cruise.add(
    goal=Constant(wanted),
    slope=TimeTable([0, 5, 6, 60, 61, 400], hill),
    v=Integrator(20),
)
pid = cruise.add(pid=PID(0.5, 0.1, lower=0.0, upper=1.0))
goal >> pid.reference
v >> pid.measurement
car(pid, v, slope) >> v
result = simulate(cruise, 400.0, step=0.01)
exact = resistance(wanted, hill[-1]) / thrust(wanted)
speed, end = result["v.y"].values, float(result["pid.y"][-1])
print(
    f"from {speed.min():.2f} to {speed.max():.2f} m/s; throttle {end:.9f}, by the law {exact:.9f}"
)
assert result["pid.y"].max() <= 1.0
assert abs(end - exact) < 1e-8
assert abs(speed[-1] - wanted) < 1e-8
