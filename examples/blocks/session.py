"""
A session: a run advanced by hand
=================================

A ``Session`` advances a run to a given time, takes external inputs, and can return to a snapshot: for
hardware tests, searches, optimizers or games.
"""

import matplotlib.pyplot as plt

from trussflow.blocks import Diagram, Session, TransferFunction

room = Diagram("room")
# K/W after ten minutes
heated = room.add(heated=TransferFunction([0.01], [600.0, 1.0]))
room.expose(power=heated.u, warmer=heated.y)

# %%
# A thermostat in plain Python: 2 kW up to 18 K above ambient, off down to 16 K.

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
        # save("halfway.state") writes a file, for another process
        halfway = session.save()

# %%
# Alternative: the heating fails after 45 minutes. Restore the snapshot and continue:

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
