"""Inspection of a log before a replay: its contents, the stereo pair, and whether the calibration fits the images."""
