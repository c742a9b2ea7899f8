"""What users declare and wire: ports, blocks, diagrams."""
