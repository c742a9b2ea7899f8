"""Cached jobs, checked numbers and evidence files of the studies."""
