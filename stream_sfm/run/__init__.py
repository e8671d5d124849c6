"""Logs through estimators: one loop, and its arrangements for one method, several methods, and learning a calibration.

`loop.py` is the page to read; `replay.py` and `compare.py` arrange it, `many.py` compares over many logs. Not here:
what is kept of a run and its pages (`report/`), its files (`results/`), many replays at once (`batch/`).
"""
