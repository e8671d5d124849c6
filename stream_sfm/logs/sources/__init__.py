"""Where the messages of a recording come from: files of one kind in `containers/`, MCAP by `mcap_file/`, and folders.

Their common protocol is in `mcap_file/message.py`; `recognise.py` finds out what a path is. Nothing here knows
which messages make a stereo pair.
"""
