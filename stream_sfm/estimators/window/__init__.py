"""The default estimator: all motions of a sliding window together, with a joint camera-centred prior.

`cross_frame.py` takes a frame through its steps, each a function of the record in `state.py`; `pipeline/` lists them in
their order. The other files here are these steps, and the blocks of the record. Behind three doors:

* `unknowns/`: what single frames have beside their poses.
* `inertia/`: inertial samples.
* `reported/`: what is read from the minimum.
"""
