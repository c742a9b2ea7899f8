"""The framework: contracts, diagram, plan, scheduler, results. It knows no concrete block."""
