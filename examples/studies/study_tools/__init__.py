"""Recorded numbers, fingerprints and evidence files of the studies."""
