"""What an FMU says about itself: variables, units, dependencies, and the XML of both versions."""
