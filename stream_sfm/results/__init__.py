"""Results of a run: written and read back."""
