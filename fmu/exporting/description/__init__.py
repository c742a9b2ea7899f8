"""Model description of an exported FMU: variables, units, dependencies, XML of both versions."""
