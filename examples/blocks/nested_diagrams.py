"""
Diagrams in diagrams
====================

A diagram is a block, and its exposed signals are its ports. Here a servo with an inner loop is used twice in
a machine with two axes. Nesting has no run-time cost: the system is flattened.
"""

import matplotlib.pyplot as plt

from trussflow.blocks import Diagram, Gain, Integrator, Sine, Sum, simulate


def servo(gain):
    """Return a position servo with a velocity loop inside: command [m] to position [m]."""
    inner = Diagram("servo")
    error, outer, rate_error, drive, speed, place = inner.add(
        error=Sum("+-"),
        outer=Gain(gain),  # 1/s
        rate_error=Sum("+-"),
        drive=Gain(50.0),  # 1/s
        speed=Integrator(),
        place=Integrator(),
    )
    error >> outer >> rate_error.u1
    rate_error >> drive >> speed >> place
    speed.y >> rate_error.u2
    place.y >> error.u2
    inner.expose(command=error.u1, position=place.y)
    return inner


machine = Diagram("machine")
x_axis, y_axis, x_goal, y_goal = machine.add(
    x_axis=servo(8.0),
    y_axis=servo(4.0),
    x_goal=Sine(1.0, frequency=0.2, phase=1.5708),
    y_goal=Sine(1.0, frequency=0.4),
)
x_goal.y >> x_axis.command
y_goal.y >> y_axis.command
machine.draw("machine.svg")

# %%
# The picture of a servo:

x_axis.draw("servo.svg")

# %%
# In a console the machine is a tree:

print(machine)

result = simulate(machine, 10.0, step=1e-3, log=[x_axis.position, y_axis.position])
plt.plot(result["x_axis.position"], result["y_axis.position"])
plt.gca().set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
plt.show()
