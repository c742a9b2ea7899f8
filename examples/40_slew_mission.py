"""
A large slew: beyond Euler angles
=================================

``slew_mission.toml`` turns the boom of an earlier example by 180 degrees while it rises by one metre. Euler
angles are singular at 90 degrees about body x, so the file selects a quaternion; its path is an axis times an
angle. Thrusters, wheels, sensors and mean-axes controller are the same.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.models import QUATERNION
from trussflow.models.transport import MissionFile, tidy

flown = MissionFile.read("slew_mission.toml")
print(
    f"the actuators need at least {flown.least_duration():.1f} s, the path takes {flown.mission.duration:g} s"
)
result = tidy(flown.simulator(flown.diagram()).run(flown.duration, progress=False), flown.truss)

# %%
# The quaternion goes from (1, 0, 0, 0) to (0, 1, 0, 0); an Euler angle phi would pass 90 degrees. The errors
# are small rotations about the axes of the boom.

rotations = np.array([QUATERNION.rotation(a) for a in result["attitude"].values])
up = np.rad2deg(np.arctan2(rotations[:, 2, 1], rotations[:, 2, 2]))
error = 1e6 * np.linalg.norm(result["attitude_error"], axis=1)
print(f"turned by {abs(up[-1]):.2f} degrees, never off by more than {error.max():.0f} µrad")

figure, (above, below) = plt.subplots(2, sharex=True)
for name in result["quaternion"].values:
    above.plot(result["time"], result["attitude"].sel(quaternion=name), label=name)
above.set(ylabel="quaternion [-]")
above.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4)
below.plot(result["time"], error)
below.set(xlabel="time [s]", ylabel="attitude error [µrad]")
plt.show()
