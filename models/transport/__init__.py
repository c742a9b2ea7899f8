"""Transport missions of the paper: four robots carry the truss."""

from trussflow.models.transport.mean_axes_wiring import (
    mean_axes_transport as mean_axes_transport,
)
from trussflow.models.transport.mission import Mission as Mission
from trussflow.models.transport.mission_file import MissionFile as MissionFile
from trussflow.models.transport.results import check_run as check_run
from trussflow.models.transport.slew import RetimedSlew as RetimedSlew
from trussflow.models.transport.slew import Slew as Slew
from trussflow.models.transport.summary import summarize as summarize
from trussflow.models.transport.wiring import path_of as path_of
from trussflow.models.transport.wiring import transport_diagram as transport_diagram
