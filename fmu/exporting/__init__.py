"""Blocks and diagrams as FMUs."""
