"""Inertial samples: what they are, how their unit is mounted and how it errs, and which of them can be used.

Not here: what they say of the motion (`estimators/cross_frame/`), and where logs have them (`recording/`).
"""
