"""Simulation: schedule of the blocks, integration between instants, and runs."""
