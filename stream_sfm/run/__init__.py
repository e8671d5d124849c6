"""Runs of logs through estimators: one loop, for one method or for several.

`loop.py` is the page to read; `replay.py` and `compare.py` use it; `refine.py` learns the errors of a
calibration from replays. Elsewhere: records and pages (`report/`), files (`results/`), batches (`batch/`).
"""
