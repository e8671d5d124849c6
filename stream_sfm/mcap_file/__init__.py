"""The MCAP container, written, and read from whole, damaged and cut-off files in bounded time and memory.

Nothing here knows cameras: messages are bytes with the schema that describes them. The page to read is `log_file.py`;
`message.py` has what it shares with all other kinds of recordings.
"""
