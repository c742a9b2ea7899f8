"""Robustness of the mean-axes controller: Monte Carlo samples, failures, margins, limits of other laws."""
