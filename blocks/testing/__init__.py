"""Checks of blocks and diagrams for their authors: what no simulation needs."""
