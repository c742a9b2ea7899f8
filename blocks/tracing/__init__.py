"""Tracing of equations into programs, and generation of C code."""
