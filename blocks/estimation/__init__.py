"""Estimation: Kalman filters as blocks, and their design from linear models and diagrams."""
