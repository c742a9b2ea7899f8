"""Frequency responses beyond Jacobians: exact delays, estimated responses."""
