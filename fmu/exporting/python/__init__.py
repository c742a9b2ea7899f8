"""Export as an FMU that runs this package in the Python of the target, with pythonfmu's binary.

`python_files`, `pickling`, `bundle` and `trial` run at export. `slave`, `instance`, `content` and
`unpickling` run inside the FMU, under a private package name.
"""
