"""Recordings of all kinds, and live cameras, as stereo frames with a rig; `recording.stereo_log.open_log` is the door.

* `sources/`: where messages come from: MCAP, bags, data sets, image files, devices.
* `mcap_file/`: the MCAP container, whole, damaged or cut off. Much of it only keeps damaged logs readable.
* `recording/`: messages to frames: topics, calibration, pairing, decoding.
* `importers.py`: copies to MCAP.
"""
