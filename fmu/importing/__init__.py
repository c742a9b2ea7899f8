"""Import of FMUs as blocks."""
