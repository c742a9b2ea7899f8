"""
Delay margin and largest sample time
====================================

``delay_margin`` returns the largest delay of a linearized position loop, ``largest_sample_time`` the largest
sample time of a digital controller. Simulations below and above that sample time confirm it.
"""

import matplotlib.pyplot as plt

from trussflow.blocks import (
    Diagram,
    StateSpace,
    ZeroOrderHold,
    delay_margin,
    largest_sample_time,
    linearize,
    loop_transfer,
    simulate,
)


def cart():
    """Return a cart of 1 kg with friction: force [N] to position [m]."""
    return StateSpace(
        [[0.0, 1.0], [0.0, -1.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]], initial_value=[1.0, 0.0]
    )


def law():
    """Return a lead that pushes back: position [m] to force [N], -40 (s + 2) / (s + 20)."""
    return StateSpace([[-20.0]], [[1.0]], [[720.0]], [[-40.0]])


def loop(period=None):
    """Return the loop, continuous or with a computer that samples the position and holds the force."""
    diagram = Diagram("cart")
    diagram.add(cart=cart(), law=law())
    if period is None:
        diagram.cart.y >> diagram.law.u
        diagram.law.y >> diagram.cart.u
    else:
        diagram.add(sampler=ZeroOrderHold(period), hold=ZeroOrderHold(period))
        diagram.cart.y >> diagram.sampler >> diagram.law.u
        diagram.law.y >> diagram.hold >> diagram.cart.u
    return diagram


late, at = delay_margin(loop_transfer(loop(), "cart.u"))
longest = largest_sample_time(linearize(cart()), linearize(law()))
print(f"stands {1e3 * late:.0f} ms of delay, at which it swings at {at:.1f} rad/s,")
print(f"or a computer that computes every {1e3 * longest:.0f} ms")

# %%
# The command is held over the whole sample time, so the largest sample time is shorter than the delay margin
# suggests.
loop(0.05).draw("held.svg")
for share in (0.3, 0.9, 1.1):
    period = round(share * longest, 3)
    result = simulate(loop(period), 8.0, solver="DOP853", log=["cart.y"], log_step=0.01)
    plt.plot(result["time"], result["cart.y"], label=f"{1e3 * period:.0f} ms")
plt.gca().set(xlabel="time [s]", ylabel="position [m]", ylim=(-3, 3))
plt.legend(title="period", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
plt.show()
