"""Many logs: each is replayed by a process of its own, and all of them share one table and one page.

`logs.py` finds and names them, `job.py` replays one, `replay_batch.py` runs all and writes batch.json and report.html.
Not here: the replay itself (`run/`), worker processes and clusters (`executors.py`).
"""
