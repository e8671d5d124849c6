"""The list of methods by name, for estimators, commands, pages and simulations. It imports nothing."""

from typing import NamedTuple


class Method(NamedTuple):
    """A class, by its module in `estimators/`, and its name on pages.

    `frames` in its window, None: as configured; `compared`: whether `compare` runs it if no method is named;
    `inertial`: whether it uses inertial samples, if it can.
    """

    module: str
    kind: str
    label: str
    frames: int | None = None
    compared: bool = True
    inertial: bool = True


REFERENCE = "cross-frame"  # the method of this package, by whose errors those of others are divided
STEPWISE = "frame-to-frame"  # the method whose errors accumulate by construction, with which drift is compared
# All methods have the covariances of the views. The window reports with these, and filters by how long errors last; two
# filters with the latter weights are rows of their own, so that rows differ in one thing.
METHODS = {
    REFERENCE: Method("window.cross_frame", "CrossFrame", "cross-frame"),
    "ekf": Method("baselines.ekf", "Ekf", "EKF with plain weights"),
    "ekf-lasting": Method("baselines.ekf", "EkfLasting", "EKF with lasting errors"),
    # Gauss-Newton on one frame's views and the joint prior is the iterated update (Bell and Cathey, The iterated Kalman
    # filter update as a Gauss-Newton method, 1993); the world is one more pose, for which iterating changes
    # nothing.
    "iterated-ekf": Method("window.cross_frame", "PlainCrossFrame", "iterated EKF with plain weights", frames=1),
    "iterated-ekf-lasting": Method(
        "window.cross_frame", "CrossFrame", "iterated EKF with lasting errors", frames=1, compared=False
    ),
    STEPWISE: Method("baselines.frame_to_frame", "FrameToFrame", "frame-to-frame"),
    "cross-frame-wc": Method("baselines.per_point", "CrossFrameWC", "per-point WC"),
    "cross-frame-cc": Method("baselines.per_point", "CrossFrameCC", "per-point CC"),
    "ekf-cv": Method("baselines.ekf", "EkfConstantVelocity", "constant-velocity EKF", inertial=False),
    "cross-frame-cc-literal": Method(
        "baselines.per_point", "CrossFrameCCLiteral", "per-point CC, literal", compared=False
    ),
    # the conventional filter: frame by frame, each point with a covariance of its own
    "depth-filter": Method("baselines.per_point", "CrossFrameWC", "filter without cross-correlations", frames=1),
}
REPLAYED = f"{REFERENCE}-replayed"  # its row with the calibration found on the way, as in a replay
WITHOUT_IMU = "cross-frame-no-imu"  # `compare` runs it if a log has samples
METHODS[WITHOUT_IMU] = METHODS[REFERENCE]._replace(label="cross-frame without IMU", compared=False, inertial=False)
COMPARED = tuple(name for name, method in METHODS.items() if method.compared)


def key_of(name: str) -> str:
    """Return the name of a method as a key in JSON, and as the name of its folder."""
    return name.replace("-", "_")
