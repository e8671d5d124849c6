"""The drift report of a comparison and the page of a batch: figures, charts and pictures in one HTML file each.

A comparison collects its `records`; `numbers` computes every figure from them, and `page` renders both. The entry
points are `page.write_report` and `batch_page.render_batch`. Nothing here reads a log or runs an estimator.
"""
