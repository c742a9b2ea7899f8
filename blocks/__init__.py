"""Block-diagram modelling and simulation: the framework and the general blocks."""

from trussflow.blocks.cosimulation.cosimulator import CoSimulator as CoSimulator
from trussflow.blocks.cosimulation.cosimulator import cosimulate as cosimulate
from trussflow.blocks.cosimulation.slave import Cosimulated as Cosimulated
from trussflow.blocks.cosimulation.slave import Slave as Slave
from trussflow.blocks.cosimulation.slave import StepDiscardedError as StepDiscardedError
from trussflow.blocks.framework.block import Block as Block
from trussflow.blocks.framework.declarations import REQUIRED as REQUIRED
from trussflow.blocks.framework.declarations import Attribute as Attribute
from trussflow.blocks.framework.declarations import Parameter as Parameter
from trussflow.blocks.framework.declarations import Signals as Signals
from trussflow.blocks.framework.declarations import State as State
from trussflow.blocks.framework.diagram import Diagram as Diagram
from trussflow.blocks.framework.errors import AlgebraicLoopError as AlgebraicLoopError
from trussflow.blocks.framework.errors import BlockError as BlockError
from trussflow.blocks.framework.errors import DiagramError as DiagramError
from trussflow.blocks.framework.errors import DivergenceError as DivergenceError
from trussflow.blocks.framework.errors import LinearAnalysisError as LinearAnalysisError
from trussflow.blocks.framework.errors import NameLookupError as NameLookupError
from trussflow.blocks.framework.errors import OpenInputError as OpenInputError
from trussflow.blocks.framework.errors import ParameterError as ParameterError
from trussflow.blocks.framework.errors import SimulationError as SimulationError
from trussflow.blocks.framework.errors import SimulationInterrupted as SimulationInterrupted
from trussflow.blocks.framework.errors import TracingError as TracingError
from trussflow.blocks.framework.errors import TrimError as TrimError
from trussflow.blocks.framework.errors import TrussflowError as TrussflowError
from trussflow.blocks.framework.errors import WiringError as WiringError
from trussflow.blocks.framework.port import INFERRED as INFERRED
from trussflow.blocks.framework.port import Input as Input
from trussflow.blocks.framework.port import Output as Output
from trussflow.blocks.framework.port import Port as Port
from trussflow.blocks.library.algebra import Concatenate as Concatenate
from trussflow.blocks.library.algebra import Function as Function
from trussflow.blocks.library.algebra import Gain as Gain
from trussflow.blocks.library.algebra import MatrixGain as MatrixGain
from trussflow.blocks.library.algebra import Product as Product
from trussflow.blocks.library.algebra import Select as Select
from trussflow.blocks.library.algebra import Sum as Sum
from trussflow.blocks.library.algebra import Terminator as Terminator
from trussflow.blocks.library.allocation import WeightedAllocation as WeightedAllocation
from trussflow.blocks.library.continuous import Integrator as Integrator
from trussflow.blocks.library.continuous import StateSpace as StateSpace
from trussflow.blocks.library.continuous import TransferFunction as TransferFunction
from trussflow.blocks.library.discrete import DiscreteStateSpace as DiscreteStateSpace
from trussflow.blocks.library.discrete import DiscreteTransferFunction as DiscreteTransferFunction
from trussflow.blocks.library.discrete import UnitDelay as UnitDelay
from trussflow.blocks.library.discrete import ZeroOrderHold as ZeroOrderHold
from trussflow.blocks.library.disturbance_observer import DisturbanceObserver as DisturbanceObserver
from trussflow.blocks.library.noise import Noise as Noise
from trussflow.blocks.library.nonlinear import DeadZone as DeadZone
from trussflow.blocks.library.nonlinear import RateLimiter as RateLimiter
from trussflow.blocks.library.nonlinear import Saturation as Saturation
from trussflow.blocks.library.pd import PD as PD
from trussflow.blocks.library.python_control import from_control as from_control
from trussflow.blocks.library.python_function import PythonFunction as PythonFunction
from trussflow.blocks.library.sliding_mode import (
    ConventionalSlidingMode as ConventionalSlidingMode,
)
from trussflow.blocks.library.sliding_mode import IntegralSlidingMode as IntegralSlidingMode
from trussflow.blocks.library.sources import Chirp as Chirp
from trussflow.blocks.library.sources import Constant as Constant
from trussflow.blocks.library.sources import Ground as Ground
from trussflow.blocks.library.sources import Ramp as Ramp
from trussflow.blocks.library.sources import Sine as Sine
from trussflow.blocks.library.sources import Step as Step
from trussflow.blocks.library.tables import Table as Table
from trussflow.blocks.library.tables import TimeTable as TimeTable
from trussflow.blocks.library.trajectory import Quintic as Quintic
from trussflow.blocks.library.trajectory import Trapezoid as Trapezoid
from trussflow.blocks.library.trajectory import Waypoints as Waypoints
from trussflow.blocks.linear_analysis.frequency.delays import delay_margin as delay_margin
from trussflow.blocks.linear_analysis.frequency.delays import (
    largest_sample_time as largest_sample_time,
)
from trussflow.blocks.linear_analysis.frequency.harmonic_balance import (
    frequency_response as frequency_response,
)
from trussflow.blocks.linear_analysis.frequency.measured_response import (
    measured_response as measured_response,
)
from trussflow.blocks.linear_analysis.linearize import Linearizer as Linearizer
from trussflow.blocks.linear_analysis.linearize import linearize as linearize
from trussflow.blocks.linear_analysis.loop_transfer import loop_transfer as loop_transfer
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint as OperatingPoint
from trussflow.blocks.linear_analysis.operating_point import (
    operating_point_after as operating_point_after,
)
from trussflow.blocks.linear_analysis.trim import Free as Free
from trussflow.blocks.linear_analysis.trim import trim as trim
from trussflow.blocks.simulation.results import save as save
from trussflow.blocks.simulation.session import Session as Session
from trussflow.blocks.simulation.session import Snapshot as Snapshot
from trussflow.blocks.simulation.simulator import Simulator as Simulator
from trussflow.blocks.simulation.simulator import simulate as simulate
from trussflow.blocks.tracing.linear_algebra import (
    solve_positive_definite as solve_positive_definite,
)
from trussflow.blocks.tracing.tracing import repeated as repeated
