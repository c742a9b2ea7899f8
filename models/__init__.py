"""The physics: flexible truss, space robots, and their equations of motion."""

from trussflow.models.arm_recursion import ArmTerms as ArmTerms
from trussflow.models.arm_recursion import arm_terms as arm_terms
from trussflow.models.assembly import DynamicsTerms as DynamicsTerms
from trussflow.models.dynamics import TrussDynamics as TrussDynamics
from trussflow.models.errors import ModelError as ModelError
from trussflow.models.nominal_model import NominalAcceleration as NominalAcceleration
from trussflow.models.nominal_model import NominalModel as NominalModel
from trussflow.models.parameter_files import ParameterTable as ParameterTable
from trussflow.models.parameter_files import shipped_file as shipped_file
from trussflow.models.robot_arm import RobotArm as RobotArm
from trussflow.models.space_truss import SpaceTruss as SpaceTruss
from trussflow.models.truss_modes import TrussModes as TrussModes
