"""Native FMUs: C from the graph of a plan, and the wrapper that follows the standard."""
