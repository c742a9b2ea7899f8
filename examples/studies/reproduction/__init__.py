"""Study of the paper's results: simulated, compared with its claims, and written as one report."""
