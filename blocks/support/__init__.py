"""Files, processes, progress, validation and messages; nothing here knows a block."""
