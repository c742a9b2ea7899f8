"""Load and call FMUs of any tool, independently of blocks."""
