"""Co-simulation: the members of a diagram coupled at communication points."""
