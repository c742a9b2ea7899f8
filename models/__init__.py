"""Physical models: flexible truss, space robots, and their equations of motion."""

from trussflow.models.dynamics.assembly import DynamicsTerms as DynamicsTerms
from trussflow.models.dynamics.dynamics import TrussDynamics as TrussDynamics
from trussflow.models.errors import ModelError as ModelError
from trussflow.models.geometry.attitude import EULER as EULER
from trussflow.models.geometry.attitude import QUATERNION as QUATERNION
from trussflow.models.geometry.attitude import (
    AttitudeCoordinates as AttitudeCoordinates,
)
from trussflow.models.hardware.hardware import Hardware as Hardware
from trussflow.models.hardware.joint_servo import JointServo as JointServo
from trussflow.models.hardware.joint_servo import ServoDesign as ServoDesign
from trussflow.models.hardware.measurement import Measurement as Measurement
from trussflow.models.hardware.motors import BrakeLatch as BrakeLatch
from trussflow.models.hardware.motors import JointDrives as JointDrives
from trussflow.models.hardware.motors import ReactionWheels as ReactionWheels
from trussflow.models.hardware.thrusters import Pulses as Pulses
from trussflow.models.hardware.thrusters import ThrusterSet as ThrusterSet
from trussflow.models.mean_axes.actuator_costs import ActuatorCosts as ActuatorCosts
from trussflow.models.mean_axes.allocation import (
    MeanAxesAllocation as MeanAxesAllocation,
)
from trussflow.models.mean_axes.controller import (
    mean_axes_controller as mean_axes_controller,
)
from trussflow.models.mean_axes.design import MeanAxesDesign as MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesEstimator as MeanAxesEstimator
from trussflow.models.mean_axes.excitation import (
    ActuatorExcitation as ActuatorExcitation,
)
from trussflow.models.mean_axes.fault_detection import FaultDetection as FaultDetection
from trussflow.models.mean_axes.free_modes import FreeModes as FreeModes
from trussflow.models.mean_axes.law import MeanAxesLaw as MeanAxesLaw
from trussflow.models.mean_axes.slowdown import PathSlowdown as PathSlowdown
from trussflow.models.mean_axes.validity import CommandHold as CommandHold
from trussflow.models.mean_axes.validity import MeasurementGate as MeasurementGate
from trussflow.models.parameter_files import ParameterTable as ParameterTable
from trussflow.models.parameter_files import shipped_file as shipped_file
from trussflow.models.plant.nominal_model import NominalModel as NominalModel
from trussflow.models.plant.nominal_model import TaskErrors as TaskErrors
from trussflow.models.plant.space_truss import SpaceTruss as SpaceTruss
from trussflow.models.plant.tunable_truss import TunableTruss as TunableTruss
from trussflow.models.robots.arm_recursion import ArmTerms as ArmTerms
from trussflow.models.robots.arm_recursion import arm_terms as arm_terms
from trussflow.models.robots.joint import Joint as Joint
from trussflow.models.robots.robot_arm import RobotArm as RobotArm
from trussflow.models.truss.frame import Frame as Frame
from trussflow.models.truss.frame import FrameMass as FrameMass
from trussflow.models.truss.frame import FrameMember as FrameMember
from trussflow.models.truss.nastran import (
    structure_from_nastran as structure_from_nastran,
)
from trussflow.models.truss.reduction import reduced_modes as reduced_modes
from trussflow.models.truss.stiffness import Rigidity as Rigidity
from trussflow.models.truss.structure import Structure as Structure
from trussflow.models.truss.truss_modes import TrussModes as TrussModes
from trussflow.models.truss.variations import loaded as loaded
from trussflow.models.truss.variations import misjudged as misjudged
from trussflow.models.truss.variations import scaled as scaled
