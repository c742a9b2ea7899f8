"""
Estimated response, and a block replaced by its gain
====================================================

A mirror tips and tilts on a flexure with weakly coupled axes. Its amplifiers have a dead zone of 20 mV, so
the linear model at rest has no loop gain. The loop is excited as in a laboratory test, the gain of the
amplifiers is estimated, and it replaces them in the linear model.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import (
    DeadZone,
    Diagram,
    MatrixGain,
    StateSpace,
    estimated_response,
    linearize,
    loop_margins,
)

stiffness = np.array([[900.0, 120.0], [120.0, 1600.0]])  # 1/s^2, per unit of inertia


def mirror_loop(amplifier):
    """Return the loop with these amplifiers, and with names for three of its signals."""
    mirror = StateSpace(
        np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -6.0 * np.eye(2)]]),
        np.vstack([np.zeros((2, 2)), 400.0 * np.eye(2)]),
        np.eye(4),
    )
    law = MatrixGain(-np.hstack([2.0 * np.eye(2), 0.05 * np.eye(2)]))
    loop = Diagram("mirror")
    loop.add(law=law, amplifier=amplifier, plant=mirror)
    law >> amplifier >> mirror
    mirror.y >> law
    loop.add_analysis_points(
        drive=amplifier.u, current=amplifier.y, angles=mirror.y[:2]
    )
    return loop


loop = mirror_loop(DeadZone(-0.02, 0.02, shape=2))
loop.draw("mirror.svg")
print(
    "slope of the amplifiers at rest:",
    np.diag(linearize(loop, "drive", "current", cut="drive").D),
)

# %%
# Sines at twenty frequencies with random phases excite both drives at once. Two runs give a response matrix;
# runs with other phases give its standard error.

omega = np.geomspace(4.0, 150.0, 20)  # rad/s
seen = estimated_response(
    loop,
    "drive",
    ["drive", "current", "angles"],
    omega=omega,
    amplitude=0.1,  # V
    step=1e-3,  # s
)
print(f"the standard error is at most {seen.standard_error[4:].max():.1e} rad/V")

# %%
# The ratio of output to input of the amplifiers is their gain. The linear loop has this gain in their place:

entering, leaving = (
    np.moveaxis(seen.complex[part], -1, 0) for part in (slice(0, 2), slice(2, 4))
)
gain = np.diag(np.mean(leaving @ np.linalg.inv(entering), axis=0)).real
linear = mirror_loop(MatrixGain(np.diag(gain)))
print("gain of the amplifiers for drives of this size:", gain.round(3))
for channel, margins in loop_margins(linear, "drive").channels.items():
    print(
        f"{channel}: phase margin {margins.phase:.0f} deg, disk margin {margins.disk:.2f}"
    )

# %%
# The model with this gain (lines), and the estimate with its errors:

model = linearize(linear, "drive", "angles").frequency_response(
    np.geomspace(4.0, 150.0, 400)
)
for (i, j), style in zip(np.ndindex(2, 2), ["C0", "C1", "C2", "C3"], strict=True):
    plt.loglog(
        model.omega,
        abs(model.complex[i, j]),
        style,
        label=f"drive {j + 1} to angle {i + 1}",
    )
    plt.errorbar(
        seen.omega,
        abs(seen.complex[4 + i, j]),
        seen.standard_error[4 + i, j],
        fmt=".",
        color=style,
    )
plt.xlabel("frequency [rad/s]")
plt.ylabel("angle per drive [rad/V]")
plt.legend()
plt.show()
