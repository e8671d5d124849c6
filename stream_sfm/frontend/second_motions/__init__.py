"""Whose motion is it: sets of tracks that move differently, and which of them is the scene's.

`motion_choice.choose` is the one decision: one motion, two, or none. The other files are evidence for it, or remember
an ambiguity until it is settled.
"""
