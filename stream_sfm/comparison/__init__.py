"""Compares methods on the same observations. `compare.py` is the page to read."""
