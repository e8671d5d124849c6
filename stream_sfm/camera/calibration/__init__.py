"""Calibration files: from the content of files to cameras.

`read.py` recognises the format by the content; rigs are made of what it returns in `camera/rig.py`. To add a format:
functions of a `Format` in `slam.py` or `projections.py`, and a line in `read.FORMATS`.
"""
