"""Copies in MCAP: data sets and folders of images as logs (docs/log-profile.md), and what is readable of damaged files.

The data sets themselves are read in `sources/`, which `open_log` uses too: an import is a copy of a source.
"""
