"""How the loop of the mean axes flies: draws, failures, margins, and where other laws end."""
