"""What can be wrong with a rig while its calibration says otherwise: shutter, clock, focus and a camera that turns.

Each `Fault` turns a clean recording into a faulty one with the same scene, path and noise. The ground truth stays that
of the left camera at the stamp.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3

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
    left, so that the right camera turns about its own centre. `shaken_hz`: the rig is shaken at that frequency;
    `dark_s`: for how long both images are black from the middle on; `shutter_s`: for how long the shutters are open.
    """

    truth: str
    readout_s: float = 0.0
    right_late_s: float = 0.0
    calibrated_focal: float = 1.0
    focus: Callable[[float, int], float] = lambda t, i: 1.0
    turn_rad: Callable[[int, int], np.ndarray] = lambda i, middle: np.zeros(3)

    shaken_hz: float = 0.0
    dark_s: float = 0.0
    shutter_s: float | None = None

    def applied(self, clean: Recording) -> Recording:
        """The recording with this fault."""

        def true_rig(i: int) -> StereoRig:
            rig = _with_focal(clean.rig, self.focus(i / clean.rate_hz, i))
            turned = se3.from_rotation_translation(se3.exp_so3(self.turn_rad(i, clean.frames // 2)), np.zeros(3))
            return replace(rig, right_from_left=turned @ rig.right_from_left)

        def path(t: float) -> np.ndarray:
            wave = np.sin(2 * np.pi * self.shaken_hz * t * np.array([1, 0.83, 1.21]) + np.array([0, 1, 2]))
            return np.asarray(clean.path(t) @ se3.exp(np.r_[0.01 * wave, SHAKEN_RAD * wave[::-1]]))

        def gains(i: int) -> tuple[float, float]:
            seconds = (i - clean.frames // 2) / clean.rate_hz
            return (0.0, 0.0) if 0 <= seconds < self.dark_s else clean.gains(i)

        return replace(
            clean,
            path=path if self.shaken_hz else clean.path,
            gains=gains if self.dark_s else clean.gains,
            shutter_s=clean.shutter_s if self.shutter_s is None else self.shutter_s,
            rig=_with_focal(clean.rig, self.calibrated_focal),
            true_rig=true_rig,
            readout_s=self.readout_s,
            right_late_s=self.right_late_s,
        )


def _with_focal(rig: StereoRig, factor: float) -> StereoRig:
    """The rig with both focal lengths multiplied; centres and distortion stay."""

    def longer(camera: Camera) -> Camera:
        return replace(camera, K=camera.K * np.array([[factor, factor, 1], [factor, factor, 1], [1, 1, 1]]))

    return rig if factor == 1 else replace(rig, left=longer(rig.left), right=longer(rig.right))


def _rolling(ms: float) -> Fault:
    return Fault(
        f"rolling shutter of both cameras, readout {ms / 1e3:g} s: row r of h is exposed at stamp + readout * "
        "(r - (h - 1) / 2) / h, the middle row at the stamp",
        readout_s=ms / 1e3,
    )


def _late(ms: float) -> Fault:
    return Fault(f"the right camera exposes {ms / 1e3:g} s after the stamp", right_late_s=ms / 1e3)


def _focal(percent: float) -> Fault:
    factor = 1 + percent / 100
    return Fault(
        f"focal lengths of the calibration are {factor:g} times the true ones of both cameras: "
        f"true over calibrated {1 / factor:.6f}",
        calibrated_focal=factor,
    )


FAULTS: dict[str, Fault] = {
    "clean": Fault("none"),
    "rs20": _rolling(20),
    "rs5": _rolling(5),
    "late2": _late(2),
    "late8": _late(8),
    **{f"focal{percent:+g}": _focal(percent) for percent in (0.5, -0.5, 0.2, -0.2)},
    **{
        f"shaken{hz}rs{ms}": Fault(
            f"shaken at {hz} Hz by {SHAKEN_RAD} rad and 1 cm, with a rolling shutter of {ms / 1e3:g} s as above",
            readout_s=ms / 1e3,
            shaken_hz=hz,
        )
        for hz, ms in ((3, 20), (4, 30), (5, 30))
    },
    "late12": _late(12),
    "dark": Fault("from frame {middle} on images are black for a second", dark_s=1.0),
    "blurred": Fault("shutters are open for 0.03 s", shutter_s=0.03),
    "autofocus2pct": Fault(
        f"true focal lengths of both cameras go from 1 to 1.02 times the calibrated ones, evenly from {FOCUS_S[0]:g} "
        f"to {FOCUS_S[1]:g} s after the first stamp",
        focus=lambda t, i: float(np.interp(t, FOCUS_S, (1.0, 1.02))),
    ),
    "autofocus01": Fault(
        "true focal lengths of both cameras in frame i are 1 + 0.0001 * i times the calibrated ones",
        focus=lambda t, i: 1 + 1e-4 * i,
    ),
    "slowturn": Fault(
        f"right_from_left of frame i is Exp(i * {TURN_PER_FRAME_RAD.round(9).tolist()} rad) times that of the "
        "calibration: 0.02 mrad per frame about the right camera's axes",
        turn_rad=lambda i, middle: i * TURN_PER_FRAME_RAD,
    ),
    "knock": Fault(
        f"from frame {{middle}} on right_from_left is Exp({KNOCK_RAD.round(9).tolist()} rad) times that of the "
        "calibration: 0.5 mrad about the right camera's axes",
        turn_rad=lambda i, middle: KNOCK_RAD if i >= middle else np.zeros(3),
    ),
}
