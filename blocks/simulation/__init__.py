"""Time: when what computes, integration between instants, results."""
