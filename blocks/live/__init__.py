"""Pages that simulate a diagram in the reader's browser: sliders, charts, step metrics, loop analysis."""
