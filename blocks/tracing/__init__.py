"""From equations to programs to C."""
