"""The observations of the front-end in a frame, and what it notices about the rig."""

from dataclasses import field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array
from ..inertial.samples import ImuCalibration, ImuSamples
from ..record import About, Kind, record
from ..rig_model.model import RigModel


@record
class MapStart:
    """The depths that a front-end with one camera has found in a frame, from which a map can start.

    `z_px` (n, 4), `cov_px` (n, 4, 4): the views of the frame with virtual right sides made from these depths.
    `first_from_cam` (4, 4), `cov_first_from_cam` (6, 6): the motion since the frame whose distance is the unit.
    """

    z_px: Array
    cov_px: Array
    first_from_cam: Array
    cov_first_from_cam: Array

    def __repr__(self) -> str:
        return f"<MapStart {len(self.z_px)} views>"


@record
class LastingErrors:
    """Temporally correlated view errors of a frame (n).

    `std_drift_px` (n,): σ of the slide of a patch over its surface since the previous frame, as the viewing
    direction changes; None if points are exact. `inflation` (n, 2): factors on the variances of left and right side
    for an estimator that treats the views of a track as independent; None if they are. `std_turn_rad`: σ about each
    axis of the apparent rotation since the previous frame by patches that slide together.
    """

    std_drift_px: Array | None = None
    inflation: Array | None = None
    std_turn_rad: float = 0.0

    def __repr__(self) -> str:
        return f"<LastingErrors of {0 if self.std_drift_px is None else len(self.std_drift_px)} views>"


@record
class Ambiguity:
    """Why the motion of the views may not be that of the camera.

    `other_from_previous` (4, 4): another motion since the previous frame that may equally be the camera's, and its
    covariance `cov_other` (6, 6), of the perturbation on the right of its inverse; or None. `misfit`: the images do
    not fit each other or the calibration; the note of the observations says why. `of_start`: this is so since the map
    began.
    """

    other_from_previous: Array | None = None
    cov_other: Array | None = None
    misfit: bool = False
    of_start: bool = False

    def __repr__(self) -> str:
        return f"<Ambiguity: {'' if self.other_from_previous is None else 'two motions '}{'misfit' * self.misfit}>"


@record
class RigChange:
    """The right camera has turned against the left one during the run, as by a knock.

    `frame_index`: the first frame that shows it; `turn_rad` (3,): about x, y and z of the rectified axes;
    `shift_px`: the shift of the right image, and `disparity_px`: the same along the rows, root mean squares over
    the image; `error_per_m`: the relative error of uncorrected distances from then on, per metre of distance.
    """

    frame_index: Annotated[int, About(Kind.FRAMES)]
    turn_rad: Array
    shift_px: float
    disparity_px: float
    error_per_m: float

    def __str__(self) -> str:
        pitch, yaw, roll = 1e3 * self.turn_rad
        return (
            f"from frame {self.frame_index} on the right camera is turned against the left one (pitch {pitch:+.2f}, "
            f"yaw {yaw:+.2f}, roll {roll:+.2f} mrad) and its image moved by {self.shift_px:.2f} px: was a camera "
            "knocked? The turn is corrected; uncorrected, distances of 10 m would be off by "
            f"{10 * self.error_per_m:.1%}"
        )

    def __repr__(self) -> str:
        return f"<RigChange at frame {self.frame_index}, {self.shift_px:.2f} px>"


@record
class RigView:
    """What errors of the rig do to the views (n) of a frame.

    `model`: the linear model of all of them. `field_std_px`: σ of those errors that no physical term follows, as the
    rows have it so far. `timing_px` (n, 4): view shifts predicted from the current delay and readout; `z_px` is
    uncorrected. `delay_by_rows`: the information that the rows have about the delay of the right camera, s⁻²,
    and its sum weighted by that, s⁻¹. `turn_root` (3, e): a root of the covariance of turns that the right camera has
    from frame to frame, radians, and `turn` (e,): the amplitudes of this frame's, if it is larger than those before, to
    begin with. `change`: the right camera has turned against the left one; the turn is taken
    out of the views from this frame on, and `change_root` (m, j) is a root of the covariance left, in σ of each error.
    """

    model: RigModel
    field_std_px: float = 0.0
    timing_px: Array | float = 0.0
    delay_by_rows: tuple[float, float] = (0.0, 0.0)
    turn_root: Array = field(default_factory=lambda: np.zeros((3, 0)))
    turn: Array = field(default_factory=lambda: np.zeros(0))
    change: RigChange | None = None
    change_root: Array | None = None

    def __repr__(self) -> str:
        return f"<RigView {len(self.model)} errors{'' if self.change is None else ', changed'}>"


@record
class InertialView:
    """The inertial `samples` that came with a frame, and the `calibration` of their unit, in rectified axes."""

    samples: ImuSamples
    calibration: ImuCalibration

    def __repr__(self) -> str:
        return f"<InertialView {len(self.samples)} samples>"


@record
class ExpectedMotion:
    """The motion since the frame at `since_ns` that inertial samples predict.

    `previous_from_cam` (4, 4) with its covariance `cov` (6, 6), right perturbation; `twist` (6,): motion of the scene
    relative to the camera at the end, m/s and rad/s. `agreed`: samples and images have agreed for so long that a motion
    that contradicts the samples is not the camera's.
    """

    since_ns: int
    previous_from_cam: Array
    cov: Array
    twist: Array
    agreed: bool = False

    def __repr__(self) -> str:
        return f"<ExpectedMotion since {self.since_ns} ns>"


@record
class Observations:
    """What the front-end found in one frame, in pixels of the rectified images.

    - `track_ids` (n,) int64, unique, ascending: a point keeps its id while it is tracked; an id that is missing in
      one frame does not return, unless that frame was skipped and has no ids at all. The last `n_new` are new.
    - `z_px` (n, 4) = (u_left, v_left, u_right, v_right), `cov_px` (n, 4, 4): the views; the right side is NaN where
      it was not found. The first view of a point has both sides.
    - `cam_from_previous` (4, 4): the front-end's own robust motion since the previous frame, as a start value; or
      None.
    - `note`: what the front-end noticed, such as "image is black"; or empty.
    - `ambiguity`: why the motion may not be the camera's; None if nothing says so.
    - `jumped`: the whole view has changed at once, so that no velocity predicts where the camera is.
    - `settled`: of two motions in earlier frames, the one that was followed was the camera's.
    - `unconfirmed`: a misfit since the map began has ended, and nothing has shown that the motion was the camera's.
    - `lasting`: errors that the views share with those of earlier frames.
    - `rig`: what errors of the rig do to the views; None if the calibration is exact.
    - `start`: with one camera, what a map can start from, as soon as depths are known.
    - `inertial`: samples of an inertial unit since the previous frame, and how it is mounted.
    """

    frame_index: int
    stamp_ns: int
    track_ids: NDArray[np.int64]
    z_px: Array
    cov_px: Array
    cam_from_previous: Array | None = None
    n_new: int = 0
    note: str = ""
    ambiguity: Ambiguity | None = None
    jumped: bool = False
    settled: bool = False
    unconfirmed: bool = False
    lasting: LastingErrors = field(default_factory=LastingErrors)
    rig: RigView | None = None
    start: MapStart | None = None
    inertial: InertialView | None = None

    @property
    def misfit(self) -> bool:
        """Whether images and calibration do not fit each other."""
        return self.ambiguity is not None and self.ambiguity.misfit

    def __repr__(self) -> str:
        note = f", {self.note}" if self.note else ""
        return f"<Observations {self.frame_index} {len(self.track_ids)} points, {self.n_new} new{note}>"
