"""Kane's equations of the whole system."""
