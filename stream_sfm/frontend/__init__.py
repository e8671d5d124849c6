"""Images to observations: rectify, detect, match left to right, track through time, reject outliers.

Here: everything that looks at pixels. Not here: the estimate (`estimators/`), files (`recording/`). The front-end
keeps its own rough motion and depths for prediction, so that what it observes does not depend on which estimator
listens, and methods can be compared on the same observations. Equations "(n)": docs/mathematics.md,
sections 3 and 11.
"""
