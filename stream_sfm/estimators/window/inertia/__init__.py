"""Inertial samples in the window: preintegrated between its frames, and believed by evidence.

`Inertia` (`inertia.py`) decides when samples are used; `InertialWindow` has the states of the window's frames.
"""
