"""The robot arms: parameters, recursion along the links, motion of the hands."""
