"""Control blocks: trajectories, observers, sliding mode, allocation, PD, PID and Kalman filters."""

from trussflow.blocks.control.kalman_filter import (
    ExtendedKalmanFilter as ExtendedKalmanFilter,
)
from trussflow.blocks.control.kalman_filter import KalmanFilter as KalmanFilter
from trussflow.blocks.control.process_models import LinearProcess as LinearProcess
from trussflow.blocks.control.process_models import NonlinearProcess as NonlinearProcess
