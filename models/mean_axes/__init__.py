"""Control of the mean axes, the rigid coordinates that follow from the momentum of the whole system."""
