"""The statements of the source, Sections 4.1 to 4.4, in its words."""

from __future__ import annotations

from reproduction import judges
from reproduction.claims import Claim

STATEMENTS = (
    Claim(
        "4.1",
        "",
        "This arrangement enables uniform load distribution to avoid actuator saturation",
        judges.uniform,
    ),
    Claim(
        "4.2",
        "3, 4",
        "excellent tracking performance, with the tracking error converging to a small "
        "neighborhood around zero and remaining stable",
        judges.tracking("case1", settles=True),
    ),
    Claim(
        "4.2",
        "3, 4",
        "it is desired that the displacement in other directions and attitude of the truss, as "
        "well as the joint angles of the space robots, remain at their initial states",
        judges.held,
    ),
    Claim(
        "4.2",
        "5",
        "the application of NDO remarkably reduces the control chattering in the system",
        judges.chattering("case1"),
    ),
    Claim(
        "4.2",
        "5",
        "thus ensuring the continuity and smoothness of the actuator input",
        judges.smooth("case1"),
    ),
    Claim(
        "4.2",
        "6",
        "most of the control force is supplied by Robot 4 during transportation",
        judges.most_by_robot_4,
    ),
    Claim("4.2", "6", "Robot 3 contributes nearly no control force", judges.nothing_by_robot_3),
    Claim("4.2", "6", "Robots 1, 2, and 4 achieve the force balance of the system", judges.balance),
    Claim(
        "4.2",
        "6",
        "Robot 3, which is positioned close to the truss centroid and the system force balance point",
        judges.near_the_centroid,
    ),
    Claim(
        "4.2",
        "6",
        "W enables appropriate force distribution, effectively reducing redundant actuator input "
        "and energy consumption",
        judges.distribution,
    ),
    Claim("4.2", "7", "the control torques remain within 0.25 N·m", judges.torque("case1")),
    Claim(
        "4.2",
        "8",
        "Robot 4 is thus expected to be the robot most affected by the flexible deformation",
        judges.most_affected,
    ),
    Claim("4.2", "8", "ensures a small, flexible displacement", judges.flexible("case1")),
    Claim("4.2", "9", "the joint motion remains stable near the initial value", judges.joint),
    Claim(
        "4.3",
        "10, 11, 12",
        "successfully fulfills the complex transportation task with a small tracking error",
        judges.tracking("case2", settles=False),
    ),
    Claim(
        "4.3",
        "13",
        "the incorporation of NDO still effectively mitigates the control chattering",
        judges.chattering("case2"),
    ),
    Claim("4.3", "13", "thus guaranteeing smooth and continuous actuator input", judges.smooth("case2")),
    Claim("4.3", "14", "the control torques remain within 0.8 N·m", judges.torque("case2")),
    Claim(
        "4.3",
        "15",
        "still ensures a small magnitude of flexible displacement for complex tasks",
        judges.flexible("case2"),
    ),
    Claim(
        "4.4",
        "16, 17",
        "significantly superior performance to the PD controller in Case 1",
        judges.better(1, "pd", "PD"),
    ),
    Claim(
        "4.4",
        "16",
        "In comparison with the SMC strategy, it achieves a smaller steady-state error [Case 1]",
        judges.better(1, "smc", "SMC", late_only=True),
    ),
    Claim("4.4", "17", "can notably mitigate velocity chattering [Case 1, against SMC]", judges.smoother(1)),
    Claim(
        "4.4",
        "18",
        "maintains superior tracking control performance for complex tasks in Case 2 [PD]",
        judges.better(2, "pd", "PD"),
    ),
    Claim(
        "4.4",
        "18",
        "maintains superior tracking control performance for complex tasks in Case 2 [SMC]",
        judges.better(2, "smc", "SMC"),
    ),
    Claim(
        "4.4",
        "19",
        "a notable reduction in velocity chattering compared with the SMC strategy [Case 2]",
        judges.smoother(2),
    ),
    Claim(
        "4.4",
        "16 to 19",
        "superior control accuracy compared with the other controllers [SMC, Case 1, peaks too]",
        judges.better(1, "smc", "SMC"),
    ),
)
"""In the order of the source. What stands in brackets is ours. The source has no Section 4.5."""
