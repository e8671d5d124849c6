"""From a frame to its estimate, without logs and files: `Engine` takes one frame and returns one estimate.

* `observer.py`: images to observations, which all methods share; `checked.py` checks what it is given.
* `lane.py`: one estimator behind an observer; `physical.py`: its solution in the axes of the physical camera.
* `stages.py`: `Pipeline`, an engine whose front-end follows the next frame meanwhile.
"""
