"""Many logs: each is replayed by its own process, and all of them share one table and one page.

`logs.py` finds and names them, `job.py` replays one, `replay_batch.py` runs all and writes batch.json and report.html.
The replay itself is in `run/`, worker processes and clusters in `executors.py`.
"""
