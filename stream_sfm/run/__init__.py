"""Logs through estimators: one loop, and its arrangements for one method, several methods.

`loop.py` is the page to read; `replay.py` and `compare.py` arrange it; `refine.py` is replays that tell how a
calibration errs. Not here: the records of a run and its pages (`report/`), its files (`results/`), batches (`batch/`).
"""
