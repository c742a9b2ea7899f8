"""Replay of a run: an HTML file with the moving truss and charts, pictures and films."""

from trussflow.models.viewer.movie import movie as movie
from trussflow.models.viewer.page import replay as replay
from trussflow.models.viewer.panel import scene_panel as scene_panel
from trussflow.models.viewer.still import still as still
