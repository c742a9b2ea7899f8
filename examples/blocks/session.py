"""
A session: the run in your hands
================================

A ``Session`` goes on as far as it is told, takes inputs from outside on the way, and can go back to a
snapshot: for a game, a hardware test, a search, or an optimizer that tries what comes next.
"""

import matplotlib.pyplot as plt

from trussflow.blocks import Diagram, Session, TransferFunction

room = Diagram("room")
heated = room.add(heated=TransferFunction([0.01], [600.0, 1.0]))  # K/W after ten minutes
room.expose(power=heated.u, warmer=heated.y)

# %%
# A thermostat in plain Python: 2 kW until it is 18 K warmer, off until 16 K.

session = Session(room, step=1.0)
session.start()
power, times, temperatures = 2000.0, [], []
for minute in range(90):
    session.set(power=power)
    session.advance(60.0 * (minute + 1))
    warmer = float(session.outputs["warmer"])
    power = 0.0 if warmer > 18.0 else 2000.0 if warmer < 16.0 else power
    times.append(session.time / 60.0)
    temperatures.append(warmer)
    if minute == 45:
        halfway = session.save()  # save("halfway.state"): a file, from which another process can go on

# %%
# What if the heating had failed after 45 minutes? Back to the snapshot, and on:

session.restore(halfway)
session.set(power=0.0)
colder = []
for minute in range(46, 90):
    session.advance(60.0 * (minute + 1))
    colder.append(float(session.outputs["warmer"]))
session.stop()
plt.plot(times, temperatures, label="thermostat")
plt.plot(times[46:], colder, label="heating lost")
plt.gca().set(xlabel="time [min]", ylabel="warmer than outside [K]")
plt.legend()
plt.show()
