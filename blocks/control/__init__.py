"""Control blocks: trajectories, observers, sliding mode, allocation, PD, PID and Kalman filters."""
