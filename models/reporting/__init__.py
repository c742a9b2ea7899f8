"""Shared parts of reports: tables, figures, metrics, output folders."""
