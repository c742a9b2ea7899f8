"""The general blocks: sources, algebra, dynamics, control. They know no truss."""
