"""Import of FMUs: safe unpacking, the description, the binary, and blocks that run it."""
