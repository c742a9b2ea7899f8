"""Import and export of diagrams of FMUs as SSP files (System Structure and Parameterization)."""
