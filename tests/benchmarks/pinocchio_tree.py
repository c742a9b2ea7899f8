"""A rigid tree of the size of the truss and its robots, for Pinocchio."""

from __future__ import annotations

import pinocchio as pin


def rigid_tree(robots=4):
    """Return a floating body with arms of seven revolute joints, for four of them 34 degrees of freedom."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "truss")
    model.appendBodyToJoint(root, pin.Inertia.Random(), pin.SE3.Identity())
    for robot in range(robots):
        parent = root
        for joint in range(7):
            name = f"robot {robot} joint {joint}"
            parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Random(), name)
            model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
    return model
