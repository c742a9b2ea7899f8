"""What a robot has between controller and physics: thrusters, wheels, drives, sensors, a computer."""
