"""Images to observations: detect, match left to right, track through time, reject outliers.

Here: everything that looks at pixels. Not here: the estimate (`estimators/`), files (`recording/`). The front-end
keeps its own rough motion and depths for prediction, so that methods can be compared on the same observations. The
only feedback from an estimator is the right-camera delay and the shutter readout (`StereoFrontEnd.learn`). Equations
"(n)" are those of docs/mathematics.md, sections 3 and 11.
"""
