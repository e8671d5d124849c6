"""The paper's simulation: scenes, motions, noise, Monte-Carlo runs, and the definitions of its table and figure.

Observations are made without images. Not here: rendered images (`tools/render/`), the estimators.
"""
