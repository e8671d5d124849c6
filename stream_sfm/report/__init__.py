"""What is kept of a run, and the pages made of it: of comparisons, batches and evaluations, one HTML file each.

`records.py` is filled frame by frame; `numbers.py` computes every figure of a comparison from it, and `pages.py` draws
them. Not here: reading logs, running estimators.
"""
