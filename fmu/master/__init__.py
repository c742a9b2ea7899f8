"""FMUs as units of a co-simulation."""
