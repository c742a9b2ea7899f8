"""Natural modes of the truss with its robots, arms locked: modal model against direct FE."""

from trussflow.models.modal_analysis.convergence import convergence as convergence
from trussflow.models.modal_analysis.convergence import convergence_text as convergence_text
from trussflow.models.modal_analysis.convergence import summary_text as summary_text
from trussflow.models.modal_analysis.direct_fe import RigidRobot as RigidRobot
from trussflow.models.modal_analysis.direct_fe import all_modes_limit as all_modes_limit
from trussflow.models.modal_analysis.direct_fe import direct_modes as direct_modes
from trussflow.models.modal_analysis.direct_fe import rigid_robots as rigid_robots
from trussflow.models.modal_analysis.locked_arms import locked_mass_matrix as locked_mass_matrix
from trussflow.models.modal_analysis.locked_arms import locked_modes as locked_modes
from trussflow.models.modal_analysis.locked_arms import truss_alone_modes as truss_alone_modes
from trussflow.models.modal_analysis.natural_modes import NaturalModes as NaturalModes
from trussflow.models.modal_analysis.natural_modes import Support as Support
from trussflow.models.modal_analysis.natural_modes import modal_assurance as modal_assurance
