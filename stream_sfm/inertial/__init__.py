"""Inertial samples, the mounting and the errors of their unit, and which samples can be used.

The motion is estimated from them in `estimators/window/`, and they are read from logs in `logs/recording/`.
"""
