"""
Robots of your own
==================

Robots come from URDF files, and each grasp point may have a different one: here two rails that slide and
turn, a shipped arm, and a bolted module of thrusters without joints.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import PD, Constant, Diagram, Step, simulate
from trussflow.models import RobotArm, SpaceTruss, TrussDynamics, TrussModes

INERTIAL = """<inertial><origin xyz="0 0 0.2"/><mass value="{}"/>
  <inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial>"""
Path("rail.urdf").write_text(f"""<robot name="rail">
  <link name="tug">{INERTIAL.format(14.0, 0.8, 0.5, 1.2)}</link>
  <link name="carriage">{INERTIAL.format(2.0, 0.05, 0.05, 0.02)}</link>
  <link name="claw">{INERTIAL.format(1.0, 0.02, 0.02, 0.01)}</link>
  <joint name="slide" type="prismatic">
    <parent link="tug"/><child link="carriage"/><origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" effort="20" velocity="0.1"/>
  </joint>
  <joint name="wrist" type="revolute">
    <parent link="carriage"/><child link="claw"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="5" velocity="0.5"/>
  </joint>
</robot>""")
# The chain from hand to base runs against the order of the file here.
rail = RobotArm.from_urdf("rail.urdf", hand="claw", base="tug")
arm = RobotArm.jaco()
module = RobotArm.from_urdf(
    "rail.urdf", hand="tug", base="tug", locked={"slide": 0.0, "wrist": 0.0}
)
for robot in (rail, arm, module):
    print(
        f"{robot.name}: {robot.mass:.1f} kg; {', '.join(joint.name for joint in robot.joint_data) or 'rigid'}"
    )

robots = (rail, arm, module, rail)
plant = SpaceTruss(
    TrussDynamics(modes=TrussModes.reconstructed(), arms=robots, elastic_integrals=True)
)
bases = 6 * plant.robots

flight = Diagram("own robots")
truss, push, hold, posture, still = flight.add(
    truss=plant,
    push=Step(
        5.0,
        initial_value=np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], plant.robots),
        final_value=0.0,
    ),
    hold=PD(np.full(plant.joints, 20.0), np.full(plant.joints, 2.0)),
    posture=Constant(plant.dynamics.rest[6 : plant.rigid]),
    still=Constant(np.zeros(plant.joints)),
)
push.y >> truss.actuation[:bases]
hold.force >> truss.actuation[bases:]
posture.y >> hold.reference_position
still.y >> hold.reference_velocity
truss.task_position[6:] >> hold.position
truss.task_velocity[6:] >> hold.velocity
result = simulate(
    flight,
    15.0,
    step=0.002,
    log=[truss.task_position, truss.grasp_displacement],
    log_step=0.02,
)

position = result["truss.task_position"]
figure, (above, below) = plt.subplots(2, sharex=True, layout="constrained")
above.plot(
    result.time,
    1e3 * position[:, [7, 15]],
    label=["slide of the first", "wrist of the last"],
)
above.set_ylabel("joints [mm, mrad]")
above.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
below.plot(
    result.time, 1e3 * result["truss.grasp_displacement"][:, :, 2], label=range(1, 5)
)
below.set(xlabel="time [s]", ylabel="grasps bend [mm]")
below.legend(title="robot", ncols=4)
plt.show()
