"""Cameras and rigs: models, lenses, rectification, calibration files."""
