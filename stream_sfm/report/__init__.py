"""The record of a run, and the pages of comparisons, batches and evaluations, one HTML file each.

`records.py` is filled frame by frame; `numbers.py` computes every figure of a comparison from it, and `pages.py` draws
them. Reading logs and running estimators is elsewhere.
"""
