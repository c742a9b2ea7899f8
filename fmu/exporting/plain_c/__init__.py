"""Plain C: a block or diagram as a header and a source, for a flight loop or a microcontroller."""
