"""Control of the mean axes: what the momentum of the whole system moves, whatever vibrates."""
