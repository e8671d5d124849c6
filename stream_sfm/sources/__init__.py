"""Where the messages of a recording come from: one file for each kind of container but MCAP, which `mcap_file/` reads.

Their one protocol is in `mcap_file/message.py`; `recognise.py` finds out what a path is. Nothing here knows which
messages make a stereo pair.
"""
