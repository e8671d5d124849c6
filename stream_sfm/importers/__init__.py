"""Data sets and folders of images to logs in MCAP; the profile is in docs/log-profile.md.

The data sets themselves are read in `sources/`, which `open_log` uses too: an import is a copy of a source.
"""
