"""The simulation of the paper: scenes, motions, noise, Monte Carlo trials, and its table and figure as studies.

Observations are simulated without images. Rendered images (`tools/render/`) and estimators are elsewhere.
"""
