"""The evidence for the source paper, reproduced and judged, as one report."""

from reproduction.results import Results as Results
from reproduction.runs import MissionRun as MissionRun
