"""Linear models whose parameters are uncertain, and bounds that hold for all of them."""

from trussflow.blocks.linear_analysis.uncertainty.robust_stability import (
    robust_stability as robust_stability,
)
from trussflow.blocks.linear_analysis.uncertainty.uncertain_model import (
    uncertain as uncertain,
)
from trussflow.blocks.linear_analysis.uncertainty.worst_case import (
    worst_gain as worst_gain,
)
