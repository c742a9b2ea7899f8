"""The loop of the mean axes flown through draws and failures, and what comes of it."""
