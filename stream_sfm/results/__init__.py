"""The results of a run: `estimates.mcap` and trajectories as text, written and read back."""
