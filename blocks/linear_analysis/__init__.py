"""Linear analysis: trim, exact Jacobians, loops broken at any wire, handed to python-control."""
