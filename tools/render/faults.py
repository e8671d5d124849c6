"""What can be wrong with a rig while its calibration says otherwise: shutter, clock, focus and a camera that turns;

and with its images: exposures that step, dirt, the own body in view, compression. Each `Fault` turns a recording into a
faulty one with the same scene, path and noise, and may be applied to one that has faults already. The ground truth
stays that of the left camera as it exposes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

from .covers import Cover
from .recording import Recording

KNOCK_RAD = 5e-4 * np.array([2, 1, 2]) / 3
TURN_PER_FRAME_RAD = 2e-5 * np.array([1, 2, -2]) / 3
SHAKEN_RAD = 0.03  # amplitude: 40 to 60 degrees per second at 4 Hz
FOCUS_S = (1.0, 3.0)  # when an autofocus moves


@dataclass(frozen=True, slots=True)
class Fault:
    """How a recording differs from the clean one, and `truth`: the sentence that says it, about {middle} as a frame.

    `calibrated_focal`: focal lengths of the calibration over the true ones. `focus(t, i)`: true focal lengths at time
    t, seconds, in frame i, over the clean ones. `turn_rad(i, middle)`: Exp of it multiplies right_from_left from the
    left, so that the right camera turns about its own centre. `stamp_error_s(i)` of frame i. `gain(i)`: brightness of
    both images over the clean ones. `covers` and `jpeg_quality` as those of a `Recording`. `shaken_hz`: the rig is
    shaken at that frequency; `dark_s`: for how long both images are black from the middle on; `shutter_s`: for how long
    the shutters are open.
    """

    truth: str
    readout_s: float = 0.0
    right_late_s: float = 0.0
    calibrated_focal: float = 1.0
    focus: Callable[[float, int], float] = lambda t, i: 1.0
    turn_rad: Callable[[int, int], np.ndarray] = lambda i, middle: np.zeros(3)
    stamp_error_s: Callable[[int], float] = lambda i: 0.0
    gain: Callable[[int], float] = lambda i: 1.0
    covers: tuple[Cover, ...] = ()
    jpeg_quality: int | None = None

    shaken_hz: float = 0.0
    dark_s: float = 0.0
    shutter_s: float | None = None

    def applied(self, before: Recording) -> Recording:
        """The recording with this fault as well."""

        def true_rig(i: int) -> StereoRig:
            rig = before.true_rig(i) if before.true_rig else before.rig
            rig = with_focal(rig, self.focus(i / before.rate_hz, i))
            turned = se3.from_rotation_translation(se3.exp_so3(self.turn_rad(i, before.frames // 2)), np.zeros(3))
            return replace(rig, right_from_left=turned @ rig.right_from_left)

        def path(t: float) -> np.ndarray:
            wave = np.sin(2 * np.pi * self.shaken_hz * t * np.array([1, 0.83, 1.21]) + np.array([0, 1, 2]))
            return np.asarray(before.path(t) @ se3.exp(np.r_[0.01 * wave, SHAKEN_RAD * wave[::-1]]))

        def gains(i: int) -> tuple[float, float]:
            left, right = before.gains(i)
            is_dark = 0 <= i - before.frames // 2 < self.dark_s * before.rate_hz
            gain = 0.0 if is_dark else self.gain(i)
            return left * gain, right * gain

        return replace(
            before,
            path=path if self.shaken_hz else before.path,
            shutter_s=before.shutter_s if self.shutter_s is None else self.shutter_s,
            rig=with_focal(before.rig, self.calibrated_focal),
            true_rig=true_rig,
            readout_s=before.readout_s + self.readout_s,
            right_late_s=before.right_late_s + self.right_late_s,
            stamp_error_s=lambda i: before.stamp_error_s(i) + self.stamp_error_s(i),
            gains=gains,
            covers=before.covers + self.covers,
            jpeg_quality=self.jpeg_quality or before.jpeg_quality,
        )


def with_focal(rig: StereoRig, factor: float) -> StereoRig:
    """The rig with both focal lengths multiplied; centres and distortion stay."""

    def longer(camera: Camera) -> Camera:
        return replace(camera, K=camera.K * np.array([[factor, factor, 1], [factor, factor, 1], [1, 1, 1]]))

    return rig if factor == 1 else replace(rig, left=longer(rig.left), right=longer(rig.right))


def rolling(ms: float) -> Fault:
    return Fault(
        f"rolling shutter of both cameras, readout {ms / 1e3:g} s: row r of h is exposed at stamp + readout * "
        "(r - (h - 1) / 2) / h, the middle row at the stamp",
        readout_s=ms / 1e3,
    )


def late(ms: float) -> Fault:
    return Fault(f"the right camera exposes {ms / 1e3:g} s after the stamp", right_late_s=ms / 1e3)


def focal(percent: float) -> Fault:
    factor = 1 + percent / 100
    return Fault(
        f"focal lengths of the calibration are {factor:g} times the true ones of both cameras: "
        f"true over calibrated {1 / factor:.6f}",
        calibrated_focal=factor,
    )


def zoom(share: float, begin_s: float, end_s: float) -> Fault:
    return Fault(
        f"true focal lengths of both cameras go from 1 to {1 + share:g} times the calibrated ones, evenly from "
        f"{begin_s:g} to {end_s:g} s after the first stamp",
        focus=lambda t, i: float(np.interp(t, (begin_s, end_s), (1.0, 1.0 + share))),
    )


def slow_turn(per_frame_rad: np.ndarray) -> Fault:
    return Fault(
        f"right_from_left of frame i is Exp(i * {per_frame_rad.round(9).tolist()} rad) times that of the calibration: "
        f"{1e3 * np.linalg.norm(per_frame_rad):.2g} mrad per frame about the right camera's axes",
        turn_rad=lambda i, middle: i * per_frame_rad,
    )


def knock(turn_rad: np.ndarray, frame: int | None = None) -> Fault:
    """`frame`: the first that shows it; the middle one by default."""
    return Fault(
        f"from frame {'{middle}' if frame is None else frame} on right_from_left is Exp({turn_rad.round(9).tolist()} "
        f"rad) times that of the calibration: {1e3 * np.linalg.norm(turn_rad):.2g} mrad about the right camera's axes",
        turn_rad=lambda i, middle: turn_rad if i >= (middle if frame is None else frame) else np.zeros(3),
    )


FAULTS: dict[str, Fault] = {
    "clean": Fault("none"),
    "rs20": rolling(20),
    "rs5": rolling(5),
    "late2": late(2),
    "late8": late(8),
    **{f"focal{percent:+g}": focal(percent) for percent in (0.5, -0.5, 0.2, -0.2)},
    **{
        f"shaken{hz}rs{ms}": Fault(
            f"shaken at {hz} Hz by {SHAKEN_RAD} rad and 1 cm, with a rolling shutter of {ms / 1e3:g} s as above",
            readout_s=ms / 1e3,
            shaken_hz=hz,
        )
        for hz, ms in ((3, 20), (4, 30), (5, 30))
    },
    "late12": late(12),
    "dark": Fault("from frame {middle} on images are black for a second", dark_s=1.0),
    "blurred": Fault("shutters are open for 0.03 s", shutter_s=0.03),
    "autofocus2pct": zoom(0.02, *FOCUS_S),
    "autofocus01": Fault(
        "true focal lengths of both cameras in frame i are 1 + 0.0001 * i times the calibrated ones",
        focus=lambda t, i: 1 + 1e-4 * i,
    ),
    "slowturn": slow_turn(TURN_PER_FRAME_RAD),
    "knock": knock(KNOCK_RAD),
}
