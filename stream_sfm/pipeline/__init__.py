"""From a frame to its estimate, without logs and files: `Engine` takes one frame and returns one estimate.

* `observer.py`: images to observations, which all methods share; `checked.py` checks what it is given.
* `lane.py`: one estimator behind an observer; `physical.py`: its solution in the axes of the physical camera.
* `stages.py`: `Pipeline`, an engine whose front-end follows the next frame meanwhile.

Front-end and estimator each take a frame through one step, `StereoFrontEnd.step` and `CrossFrame.step`. Both steps are
functions of a record that they replace, `FrontEndState` and `WindowState`, and have the same verbs:

    what is done                     front-end                    estimator
    -------------------------------  ---------------------------  ---------------------------
    expect a motion                  Step.of                      inertia.enter
    see the points again             find_rough_motion            points_seen_again
    drop what is not the scene       overlays                     (known from earlier frames)
    expect each view                 first_timed, align           expect, _corrected
    agree on a motion                _agreed_motion               initial_motion
    let the cameras explain more     _turned                      weigh_unknowns
    compare with samples             (in _agreed_motion)          inertia.judge
    go on to the new frame           learn, advance               absorbed_oldest, entered
    keep a second motion in mind     (in advance)                 with_second, settled
    refine                           (each point, in advance)     renewed_timing, minimised
    judge the cameras                _check                       judged_rig
    begin points                     begin_points                 (in entered)
    report                           _observed                    reported, _solution_of
    learn for the next frame         errors.after                 learnt_rig
"""
