"""A recording as a stereo log: which topics are the cameras, how they are calibrated, and their frames in order.

`stereo_log.open_log` is the entry point, and the page to read first.
"""
