"""Linear models whose parameters are uncertain, and bounds that hold for all of them."""
