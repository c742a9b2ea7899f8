"""Frequency responses beyond Jacobians: describing functions, measured responses, delays."""
