"""An FMU of any tool, loaded and called; knows no block."""
