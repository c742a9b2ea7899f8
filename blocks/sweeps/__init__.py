"""Many runs of one diagram: what varies, who runs them, and what is kept of them."""
