"""
Hardware in the loop, by UDP and in real time
=============================================

A simulated cart is held by a controller outside of the diagram. ``UdpSend`` and ``UdpReceive`` exchange packets
with it, and ``pace=1.0`` lets simulated time pass as fast as wall time.
"""

import socket
import struct
import threading

import matplotlib.pyplot as plt

from trussflow.blocks import Diagram, Integrator, Sine, UdpReceive, UdpSend, simulate

# %%
# The controller is a thread in place of a device: it answers each position and rate with a force. A packet has
# numbers of 8 bytes: the time of the sender, then the elements of the signal.

device = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
device.bind(("127.0.0.1", 0))
device.settimeout(1.0)
answers = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
answers.bind(("127.0.0.1", 0))
answer_port = answers.getsockname()[1]
answers.close()


def control():
    """Answer packets until none comes any more."""
    while True:
        try:
            time, position, rate = struct.unpack("<3d", device.recv(100))
        except TimeoutError:
            return
        force = -15.0 * position - 6.0 * rate
        device.sendto(struct.pack("<2d", time, force), ("127.0.0.1", answer_port))


thread = threading.Thread(target=control)
thread.start()

# %%
# The force is held if no answer comes. Its age shows that.

loop = Diagram("hardware in the loop")
force = loop.add(force=UdpReceive(0.02, answer_port))
gust, rate, position = loop.add(
    gust=Sine(2.0, 3.0), rate=Integrator(), position=Integrator(0.5)
)
(force.y + gust) >> rate >> position
state = loop.add(send=UdpSend(0.02, device.getsockname()[1], shape=2))
position >> state.u[0]
rate >> state.u[1]
result = simulate(loop, 2.0, step=5e-3, pace=1.0)
print(
    "late",
    result.attrs["overruns"],
    "times; oldest force [s]",
    float(result["force.age"].max()),
)

plt.plot(result["time"], result["position.y"])
plt.gca().set(xlabel="time [s]", ylabel="position [m]")
plt.show()

thread.join()
device.close()
