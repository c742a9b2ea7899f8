"""Block-diagram modelling and simulation: the framework and the general blocks."""

from trussflow.blocks.control.allocation import BoundedAllocation as BoundedAllocation
from trussflow.blocks.control.allocation import (
    RateBoundedAllocation as RateBoundedAllocation,
)
from trussflow.blocks.control.allocation import WeightedAllocation as WeightedAllocation
from trussflow.blocks.control.disturbance_observer import (
    DisturbanceObserver as DisturbanceObserver,
)
from trussflow.blocks.control.input_shaping import ShapedTrajectory as ShapedTrajectory
from trussflow.blocks.control.kalman_design import GaussMarkov as GaussMarkov
from trussflow.blocks.control.kalman_design import kalman_filter as kalman_filter
from trussflow.blocks.control.pd import PD as PD
from trussflow.blocks.control.pid import PID as PID
from trussflow.blocks.control.pid import DiscretePID as DiscretePID
from trussflow.blocks.control.sliding_mode import (
    ConventionalSlidingMode as ConventionalSlidingMode,
)
from trussflow.blocks.control.sliding_mode import (
    IntegralSlidingMode as IntegralSlidingMode,
)
from trussflow.blocks.control.time_scaling import RetimedQuintic as RetimedQuintic
from trussflow.blocks.control.trajectory import Quintic as Quintic
from trussflow.blocks.control.trajectory import Trapezoid as Trapezoid
from trussflow.blocks.control.trajectory import Waypoints as Waypoints
from trussflow.blocks.cosimulation.cosimulator import CoSimulator as CoSimulator
from trussflow.blocks.cosimulation.cosimulator import cosimulate as cosimulate

# sets the drawing functions of Diagram
from trussflow.blocks.drawing import page as _drawing_page  # noqa: F401
from trussflow.blocks.framework.arithmetic import Operation as Operation
from trussflow.blocks.framework.block import Block as Block
from trussflow.blocks.framework.declarations import Attribute as Attribute
from trussflow.blocks.framework.declarations import Event as Event
from trussflow.blocks.framework.declarations import Mode as Mode
from trussflow.blocks.framework.declarations import Parameter as Parameter
from trussflow.blocks.framework.declarations import Signals as Signals
from trussflow.blocks.framework.declarations import State as State
from trussflow.blocks.framework.diagram import Diagram as Diagram
from trussflow.blocks.framework.energy import EnergyAccount as EnergyAccount
from trussflow.blocks.framework.equations import Equations as Equations
from trussflow.blocks.framework.port import INFERRED as INFERRED
from trussflow.blocks.framework.port import REQUIRED as REQUIRED
from trussflow.blocks.framework.port import Input as Input
from trussflow.blocks.framework.port import Output as Output
from trussflow.blocks.framework.port import Port as Port
from trussflow.blocks.framework.symbol import Symbol as Symbol
from trussflow.blocks.library.algebra import Function as Function
from trussflow.blocks.library.algebra import Gain as Gain
from trussflow.blocks.library.algebra import MatrixGain as MatrixGain
from trussflow.blocks.library.algebra import Sum as Sum
from trussflow.blocks.library.algebra import Terminator as Terminator
from trussflow.blocks.library.continuous import Integrator as Integrator
from trussflow.blocks.library.continuous import StateSpace as StateSpace
from trussflow.blocks.library.continuous import TransferFunction as TransferFunction
from trussflow.blocks.library.discrete import DiscreteStateSpace as DiscreteStateSpace
from trussflow.blocks.library.discrete import (
    DiscreteTransferFunction as DiscreteTransferFunction,
)
from trussflow.blocks.library.discrete import UnitDelay as UnitDelay
from trussflow.blocks.library.discrete import ZeroOrderHold as ZeroOrderHold
from trussflow.blocks.library.discrete import sampled_delay as sampled_delay
from trussflow.blocks.library.groups import enabled as enabled
from trussflow.blocks.library.noise import Drift as Drift
from trussflow.blocks.library.noise import Noise as Noise
from trussflow.blocks.library.nonlinear import Backlash as Backlash
from trussflow.blocks.library.nonlinear import DeadZone as DeadZone
from trussflow.blocks.library.nonlinear import Quantizer as Quantizer
from trussflow.blocks.library.nonlinear import RateLimiter as RateLimiter
from trussflow.blocks.library.nonlinear import Saturation as Saturation
from trussflow.blocks.library.python_control import from_control as from_control
from trussflow.blocks.library.python_control import lqr as lqr
from trussflow.blocks.library.python_function import PythonFunction as PythonFunction
from trussflow.blocks.library.python_function import as_block as as_block
from trussflow.blocks.library.rigid_body import RigidBody as RigidBody
from trussflow.blocks.library.sources import Constant as Constant
from trussflow.blocks.library.sources import Ground as Ground
from trussflow.blocks.library.sources import Ramp as Ramp
from trussflow.blocks.library.sources import Sine as Sine
from trussflow.blocks.library.sources import Step as Step
from trussflow.blocks.library.sources import TimeFunction as TimeFunction
from trussflow.blocks.library.state_machine import StateMachine as StateMachine
from trussflow.blocks.library.switching import LimitedIntegrator as LimitedIntegrator
from trussflow.blocks.library.switching import Pulse as Pulse
from trussflow.blocks.library.switching import Relay as Relay
from trussflow.blocks.library.switching import StopWhen as StopWhen
from trussflow.blocks.library.switching import Switch as Switch
from trussflow.blocks.library.tables import GridTable as GridTable
from trussflow.blocks.library.tables import Table as Table
from trussflow.blocks.library.tables import TimeTable as TimeTable
from trussflow.blocks.library.transport_delay import TransportDelay as TransportDelay
from trussflow.blocks.library.transport_delay import VariableDelay as VariableDelay
from trussflow.blocks.library.udp import UdpReceive as UdpReceive
from trussflow.blocks.library.udp import UdpSend as UdpSend
from trussflow.blocks.linear_analysis.families import linearize_over as linearize_over
from trussflow.blocks.linear_analysis.frequency.delays import (
    delay_margin as delay_margin,
)
from trussflow.blocks.linear_analysis.frequency.estimated_response import (
    estimated_response as estimated_response,
)
from trussflow.blocks.linear_analysis.frequency.frequency_response import (
    frequency_response as frequency_response,
)
from trussflow.blocks.linear_analysis.linearize import Linearizer as Linearizer
from trussflow.blocks.linear_analysis.linearize import linearize as linearize
from trussflow.blocks.linear_analysis.loop_transfer import loop_margins as loop_margins
from trussflow.blocks.linear_analysis.loop_transfer import (
    loop_transfer as loop_transfer,
)
from trussflow.blocks.linear_analysis.loop_transfer import sensitivity as sensitivity
from trussflow.blocks.linear_analysis.modal_bode import modal_bode as modal_bode
from trussflow.blocks.linear_analysis.modal_table import modal_table as modal_table
from trussflow.blocks.linear_analysis.operating_point import (
    OperatingPoint as OperatingPoint,
)
from trussflow.blocks.linear_analysis.operating_point import (
    operating_point_after as operating_point_after,
)
from trussflow.blocks.linear_analysis.trim import Free as Free
from trussflow.blocks.linear_analysis.trim import trim as trim

# sets the function of Diagram that writes live pages
from trussflow.blocks.live import page as _live  # noqa: F401
from trussflow.blocks.results.conversions import plot as plot
from trussflow.blocks.results.conversions import to_control as to_control
from trussflow.blocks.results.conversions import to_pandas as to_pandas
from trussflow.blocks.results.dataset import load as load
from trussflow.blocks.results.dataset import save as save
from trussflow.blocks.results.streamed_log import recover as recover
from trussflow.blocks.simulation.session import Session as Session
from trussflow.blocks.simulation.simulator import Simulator as Simulator
from trussflow.blocks.simulation.simulator import simulate as simulate
from trussflow.blocks.sweeps.gradients import gradient as gradient
from trussflow.blocks.sweeps.sweep import rerun as rerun
from trussflow.blocks.sweeps.sweep import sweep as sweep
from trussflow.blocks.sweeps.tuning import tune as tune
from trussflow.blocks.tracing.kernels import repeated as repeated
from trussflow.blocks.tracing.linear_algebra import (
    solve_positive_definite as solve_positive_definite,
)
