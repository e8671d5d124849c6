"""What is kept of a run, and the pages made of it: of comparisons, batches and evaluations, one HTML file each.

`records.py` and `front_record.py` are filled frame by frame; `numbers.py` computes every figure of a comparison from
them, and `page.py` draws them. `batch_page.py` and `evaluation_page.py` are the other pages. Not here: reading logs,
running estimators.
"""
