"""Pictures of diagrams: layers from left to right, orthogonal wires, SVG."""
