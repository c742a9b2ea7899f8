"""Logs, datasets, files of results and of states."""
