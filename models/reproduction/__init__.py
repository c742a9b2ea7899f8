"""The evidence for the source paper, reproduced and judged, as one report."""

from trussflow.models.reproduction.ledger import Ledger as Ledger
from trussflow.models.reproduction.parallel import perform_all as perform_all
from trussflow.models.reproduction.results import Results as Results
from trussflow.models.reproduction.runs import MissionRun as MissionRun
