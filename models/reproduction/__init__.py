"""The evidence for the source paper, reproduced and judged, as one report."""

from trussflow.models.reproduction.results import Results as Results
from trussflow.models.reproduction.runs import MissionRun as MissionRun
