"""Size of the campaign: ``make campaign CAMPAIGN=10`` runs ten times as many random cases.

Tests that draw cases at random scale their number with ``SIZE`` and start from ``SEED``.
"""

import os

import pytest

SIZE = int(os.environ.get("CAMPAIGN", "1"))
SEED = int(os.environ.get("CAMPAIGN_SEED", "0"))


def only(*values):
    """Return arguments of a parametrized test that only the campaign runs."""
    return pytest.param(*values, marks=pytest.mark.campaign)
