"""Where the messages of a recording come from: one file for each kind of container, behind one small protocol.

`source.py` is the protocol; `recognise.py` finds out what a path is. Nothing here knows which messages make a stereo
pair.
"""
