"""Exchange of diagrams with other tools as FMUs; comes with a later release."""
