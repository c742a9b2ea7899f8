"""System structures (SSP): diagrams of FMUs as one file."""
