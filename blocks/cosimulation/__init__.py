"""Co-simulation: the units of a diagram coupled at communication points."""
