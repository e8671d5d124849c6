"""Every method on the same observations."""
