"""Errors that many views share: one linear model with a Gaussian prior, section 12.

A view is z = h(P) + B(z, ż) c + Φ(z) a + noise. The terms c have physical names (`terms.py`): lenses and relative
rotation, the focal length, the delay of the right camera, the readout of a rolling shutter. Φ a is a smooth field that
is fixed in the image (`field.py`), for errors that no physical term follows. `model.py` combines them, `sizes.py`
learns the size of each.

The errors are estimated elsewhere (`estimators/window/rig_state.py`, `frontend/learnt/rows.py`).
"""
