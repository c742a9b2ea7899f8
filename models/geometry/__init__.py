"""Rotations and spatial vectors."""
