"""Images to observations: detect, match left to right, track through time, reject outliers.

All code that looks at pixels is here. Estimates are in `estimators/`, recordings in `logs/`. The front-end predicts
with a rough motion and depths of its own, so that methods can be compared on the same observations. The only feedback
from an estimator is about the rig: right-camera delay, shutter readout, disparity errors (`StereoFrontEnd.learn`).
Equations "(n)" are those of docs/mathematics.md, sections 3 and 11.
"""
