"""Export of blocks and diagrams as FMUs and plain C."""
