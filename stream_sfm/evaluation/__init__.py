"""Accuracy and consistency of a trajectory against ground truth: pure functions of `Trajectory`.

The definitions are in docs/mathematics.md, section 10. Not here: files and plots (`report/`), simulated scenes,
whose truth is known by track id (`simulation/measure.py`).
"""
