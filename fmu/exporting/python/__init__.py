"""Export as an FMU that runs in the Python of the target, with pythonfmu's binary.

`python_files` and `pickling` run at export. `slave`, `instance` and `payload` run in the FMU, from the
trussflow that is installed on the target.
"""
