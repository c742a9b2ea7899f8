"""Checks of blocks and diagrams for their authors: what no simulation needs."""

from trussflow.blocks.testing.check_block import check_block as check_block
from trussflow.blocks.testing.energy_audit import energy_audit as energy_audit
