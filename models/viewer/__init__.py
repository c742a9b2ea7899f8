"""A run to look at: one HTML file with the truss in motion and charts, and still pictures of it."""

from trussflow.models.viewer.page import Section as Section
from trussflow.models.viewer.page import replay as replay
from trussflow.models.viewer.still import still as still
