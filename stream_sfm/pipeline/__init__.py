"""Replays a log: its frames through the engine into sinks, then a summary. `replay.py` is the page to read."""
