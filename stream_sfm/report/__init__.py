"""The one-file drift report: what a comparison collected (`records`), figures (`numbers`), pictures, and the page.

The way in is `write_report`. Nothing here reads a log or runs an estimator.
"""
