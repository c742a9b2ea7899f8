"""Export as plain C: a header and a source for a flight computer or a microcontroller."""
