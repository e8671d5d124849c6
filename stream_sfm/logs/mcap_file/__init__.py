"""The MCAP container: writing, and reading of intact, damaged and cut-off files in bounded time and memory.

Nothing here knows about cameras: messages are bytes with the schema that describes them. The page to read is
`log_file.py`; `message.py` has what all kinds of recordings share.
"""
