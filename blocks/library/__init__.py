"""General blocks: sources, algebra, dynamics, nonlinearities, switching, groups."""
