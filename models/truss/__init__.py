"""The flexible truss: finite elements, modes, and the integrals of Kane's equations."""
