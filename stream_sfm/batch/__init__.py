"""Many logs: which ones, one process a log, and the table and page of all.

`logs.py` finds and names them, `job.py` does one, `collect.py` does all and writes batch.json and report.html.
Not here: the replay itself (`run.py`), workers and clusters (`executors.py`).
"""
