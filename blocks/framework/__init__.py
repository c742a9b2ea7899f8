"""Declaration and connection of ports, blocks and diagrams."""
