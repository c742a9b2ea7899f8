"""Export as an FMU that runs this package in the Python of the target, by pythonfmu's binary.

`export` packs, `pickling` and `bundle` say what into; `slave`, `instance`, `content` and
`unpickling` are what runs inside the FMU, under a package name of its own.
"""
