"""Calibration files: one module per format, from the content of files to cameras.

`read.py` recognises the format by the content; rigs are made of what it returns in `camera/rig.py`. To add a format:
a module with `NAME`, `matches`, `pair` and `left`, and a line in `read.FORMATS`.
"""
