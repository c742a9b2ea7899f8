"""Export of native FMUs: C code of a plan, and the C functions of the FMI standard."""
