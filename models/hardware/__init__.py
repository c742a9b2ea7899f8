"""Hardware between controller and plant: thrusters, wheels, joint drives, sensors, computer."""
