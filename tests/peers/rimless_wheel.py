"""
A wheel without a rim (Drake)
=============================

A wheel of eight spokes rolls down a slope and loses speed at each spoke, ω⁺ = ω⁻ cos 2α. In the steady
gait gravity restores it: ω⁻² - ω⁺² = 4 g sin α sin γ / l. Drake: ``rimless_wheel``.
"""

import numpy as np

from trussflow.blocks import Block, Diagram, Event, Mode, Output, State, simulate

g, length, alpha, gamma = 9.81, 1.0, np.pi / 8, 0.08


class Wheel(Block):
    """Wheel on one spoke, with the angle of that spoke from the vertical."""

    rate = Output(unit="rad/s")
    angle, w = State(initial=gamma - alpha), State(initial=2.0)
    landed = Mode(meaning="rate after the last spoke landed")
    lands = Event("rising")

    def output(self, t, x, u, p):
        """Return the rate."""
        return {"rate": x.w}

    def derivative(self, t, x, u, p):
        """Return the rates of an inverted pendulum."""
        return {"angle": x.w, "w": g / length * np.sin(x.angle)}

    def indicators(self, t, x, u, p):
        """Return the depth of the next spoke in the ground."""
        return {"lands": x.angle - (gamma + alpha)}

    def on_event(self, t, x, u, p, fired):
        """Change to the next spoke."""
        w = x.w * np.cos(2 * alpha)
        return {"angle": gamma - alpha, "w": w, "landed": w}


slope = Diagram("slope")
slope.add(wheel=Wheel())
landed = float(
    simulate(slope, 60.0, step=1e-3, log=["wheel.landed"])["wheel.landed"][-1]
)
gained = 4 * g / length * np.sin(alpha) * np.sin(gamma)
steady = np.cos(2 * alpha) * np.sqrt(gained / (1 - np.cos(2 * alpha) ** 2))
print(f"rate after landing {landed:.12f}, by the law {steady:.12f} rad/s")
assert abs(landed - steady) < 1e-10
