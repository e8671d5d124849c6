"""The package's own ROS 2 messages: their definitions, and what of a `FrameEstimate` is in which field, both ways.

Matrices are written row by row. A dict of numbers by name is two arrays, `<field>_names` and `<field>`.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import Field, fields
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..camera.refinement import LENS_TERMS
from ..config import RigConfig
from ..geometry import se3
from ..inertial.state import ACCEL_BIAS, AXES, CLOCK, GRAVITY, GYRO_BIAS, SCALE, VELOCITY
from ..record import Kind, about, plain_type
from ..rig_model.estimate import RigEstimate
from ..rig_model.terms import CAUSES, TERMS, at, prior_std
from ..types import CommonErrors, FrameEstimate, InertialEstimate, RelativeMotions, Solution, Status

SCHEMA_VERSION = 2
ESTIMATE, SCALARS, TIMING = (f"stream_sfm_msgs/msg/{name}" for name in ("Estimate", "Scalars", "Timing"))
_PARTS: dict[str, type] = {"relative": RelativeMotions, "common": CommonErrors}  # their fields have a prefix
_FORMER = {"relative_frame_from_newest": "relative_frame_from_cam"}  # names of fields in older files
_NUMBERS = {int: "int64", float: "float64", bool: "bool"}


@cache
def _described(of: type) -> list[Field[Any]]:
    """Return the fields of a record that are in a message as they are."""
    return [f for f in fields(of) if about(f).says]


def _line(of: Field[Any], prefix: str = "") -> str:
    description, kind = about(of), _NUMBERS.get(plain_type(of), "string")
    if description.shape is not None:
        size = math.prod(description.shape) if all(isinstance(n, int) and n > 0 for n in description.shape) else ""
        kind = f"{'int64' if description.kind is Kind.FRAMES else 'float64'}[{size}]"
    return f"{kind} {prefix}{of.name}  # {description.says}"


_OF_FRAME = {f.name for f in fields(FrameEstimate)} - {f.name for f in fields(Solution)}
_PLAIN = sorted(_described(FrameEstimate), key=lambda f: f.name not in _OF_FRAME)
_DESCRIBED = "\n".join(
    [*map(_line, _PLAIN), *(_line(f, f"{prefix}_") for prefix, part in _PARTS.items() for f in _described(part))]
)
_OF_CAUSES = "\n".join(f"float64[] rig_{c.key}  # {c.meaning}; then σ of each; or empty" for c in CAUSES)
# A field and its explanation per line.
_FIELDS = {
    ESTIMATE: f"""\
std_msgs/Header header  # One frame of /stream_sfm/estimate: everything except the points (/stream_sfm/points and \
/stream_sfm/map).
int64 schema_version  # raised when a field changes its meaning
{_DESCRIBED}
float64[] relative_frame_from_cam  # relative_frame_from_newest under its former name, for programs that read it
string[] counts_names  # points tracked, new, used, rejected
int64[] counts
float64[] rig_error_px  # errors of the calibration as known now, px; empty where it is taken for exact
float64[] rig_cov_px2  # their covariance, one matrix, or empty
{_OF_CAUSES}
float64[] rig_evidence  # on how many σ thirds of the run agree about each term; empty while it is short
bool rig_applied  # whether the calibration is more probably wrong than right
float64[] inertial_state  # by inertial samples: velocity, gravity, both in the camera, biases of gyroscope and \
accelerometer, scale, turn of the unit, time offset: 17 numbers; or empty
float64[] inertial_cov  # joint covariance 23×23 of ξ and that state
float64[] inertial_densities  # factors on the noise densities of gyroscope and accelerometer, as learnt
float64 inertial_distance2  # squared distance of the images' motion from that of the samples, 6 expected
bool dead_reckoned  # the pose is by inertial samples alone
""",
    SCALARS: """\
std_msgs/Header header  # One frame of /stream_sfm/scalars: numbers to plot, one field each.
float64 x  # position in the world, as in /stream_sfm/pose
float64 y  # position
float64 z  # position
float64 sigma_x  # its standard deviation along the same axis
float64 sigma_y  # its standard deviation along the same axis
float64 sigma_z  # its standard deviation along the same axis
float64 sigma_position  # square root of the trace of the position's covariance
float64 sigma_rotation_deg  # the same of the rotation, degrees
float64 speed  # since the previous frame, per second
float64 angular_speed_deg_s  # since the previous frame, degrees per second
float64 path_length  # along the motions between frames so far
int64 points_tracked  # points that are followed
int64 points_new  # points seen for the first time
int64 points_used  # points whose views were accepted
int64 points_rejected  # points whose views were rejected
float64 nis_per_dof  # 1 on average where the noise is as assumed; NaN without views
int64 status  # 0 initialising, 1 ok, 2 degraded, 3 lost
""",
    TIMING: """\
std_msgs/Header header  # One frame of /stream_sfm/timing, the only topic that differs between two runs of one log.
int64 frame_index  # as in /stream_sfm/estimate
string[] timings_ms_names  # stages, and the milliseconds that each took
float64[] timings_ms
""",
}
# As ROS reads them: an explanation above its field.
DEFINITIONS = {name: re.sub(r"^(.+)  # (.+)$", r"# \2\n\1", text, flags=re.MULTILINE) for name, text in _FIELDS.items()}
Part = TypeVar("Part")


def named(field: str, numbers: Mapping[str, float]) -> dict[str, Any]:
    """Return the two fields of numbers by name."""
    return {f"{field}_names": list(numbers), field: list(numbers.values())}


def estimate_fields(estimate: FrameEstimate) -> dict[str, Any]:
    """Return the fields of an ESTIMATE, without its header; `estimate_of` is the inverse."""
    rig, n = estimate.rig, len(LENS_TERMS)
    values = {f.name: getattr(estimate, f.name) for f in _PLAIN}
    values |= {"schema_version": SCHEMA_VERSION, **named("counts", estimate.counts)}
    for prefix, kind in _PARTS.items():
        part = {f"{prefix}_{f.name}": getattr(getattr(estimate, prefix), f.name, None) for f in _described(kind)}
        values |= {name: () if value is None else value for name, value in part.items()}
    values["common_since"] = 0 if estimate.common is None else estimate.common.since
    values |= {former: values[name] for name, former in _FORMER.items()}
    values["rig_applied"] = rig is not None and rig.applied
    values |= {f"rig_{cause.key}": () if rig is None else rig.group(cause) for cause in CAUSES}
    values["rig_evidence"] = () if rig is None or rig.evidence is None else rig.evidence
    values |= _inertial_fields(estimate.inertial)
    of_lenses = ((), ()) if rig is None else (rig.mean[:n], rig.cov[:n, :n])
    return values | dict(zip(("rig_error_px", "rig_cov_px2"), of_lenses, strict=True))


def _inertial_fields(of: InertialEstimate | None) -> dict[str, Any]:
    if of is None:
        names = ("inertial_state", "inertial_cov", "inertial_densities")
        return dict.fromkeys(names, ()) | {"inertial_distance2": 0.0, "dead_reckoned": False}
    parts = of.velocity, of.gravity, of.gyro_bias, of.accel_bias, [of.scale], of.axes_rad, [of.time_offset_s]
    return {
        "inertial_state": np.concatenate(parts),
        "inertial_cov": of.cov,
        "inertial_densities": of.densities,
        "inertial_distance2": of.distance2,
        "dead_reckoned": of.dead_reckoned,
    }


def _inertial(m: Any) -> InertialEstimate | None:
    """Return the recorded inertial state; None where there is none, as in files of earlier versions."""
    s: Any = getattr(m, "inertial_state", ())
    if not len(s):
        return None
    of = np.asarray(s)
    rest = m.inertial_cov.reshape(23, 23), m.inertial_densities, m.inertial_distance2, m.dead_reckoned
    moving = of[VELOCITY], of[GRAVITY], of[GYRO_BIAS], of[ACCEL_BIAS]
    return InertialEstimate(*moving, float(of[SCALE][0]), of[AXES], float(of[CLOCK][0]), *rest)


def estimate_of(m: Any, points: tuple[NDArray[Any], ...] | None = None) -> FrameEstimate:
    """Return the content of an ESTIMATE, with the ids, points and covariances of another message if given.

    Points in the world, those that have left the view, and times per stage are left out. A field that the message does
    not have, as in files of earlier versions, has its default.
    """
    track_ids, points_in_cam, cov_points = points or (np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3, 3)))
    in_cam = points_in_cam.astype(float)
    values = {f.name: _shaped(getattr(m, f.name), f) for f in _PLAIN if hasattr(m, f.name)}
    values["status"] = Status(m.status)
    common = _part(m, "common", CommonErrors)
    return FrameEstimate(
        **values,
        track_ids=track_ids,
        points_in_cam=in_cam,
        cov_points=cov_points.astype(float),
        points_in_world=se3.transform(values["world_from_cam"], in_cam),
        cov_points_in_world=np.full((len(in_cam), 3, 3), np.nan),
        counts=dict(zip(m.counts_names, m.counts.tolist(), strict=True)),
        timings_ms={},
        relative=_part(m, "relative", RelativeMotions, m=0 if common is None else len(common.mean)),
        common=common,
        rig=_rig(m) if len(getattr(m, "rig_error_px", ())) else None,
        inertial=_inertial(m),
    )


def _shaped(value: Any, of: Field[Any], m: int = -1) -> Any:
    """Return the value of a field from how a message has it, flat; `m` common errors."""
    shape = about(of).shape
    return value if shape is None else value.reshape([m if size == "m" else size for size in shape])


def _part(message: Any, prefix: str, kind: type[Part], m: int | None = None) -> Part | None:
    """Return a part of an estimate; None where the message has nothing of it."""
    values: dict[str, Any] = {}
    for f in fields(kind):  # type: ignore[arg-type]
        name = f"{prefix}_{f.name}"
        value = getattr(message, name, getattr(message, _FORMER.get(name, name), ()))
        if np.ndim(value) == 0:  # a number, which is there even where the part is not
            values |= {f.name: value} if values else {}
            continue
        m = len(value) if m is None else m  # the first field of common errors is their mean
        if len(value) and (m or "m" not in (about(f).shape or ())):
            values[f.name] = _shaped(value, f, m)
    return kind(**values) if values else None


def _rig(message: Any) -> RigEstimate:
    """Return the recorded errors of the rig; the smooth field and the prior are not recorded.

    An error that the file does not have is 0, with the σ that is assumed of it.
    """
    mean, std = np.zeros(len(TERMS)), prior_std(RigConfig())
    for cause in CAUSES:
        recorded = np.asarray(getattr(message, f"rig_{cause.key}", ()))
        if len(recorded):
            mean[at(cause.terms)], std[at(cause.terms)] = recorded.reshape(2, -1)
    cov, n = np.diag(std**2), len(message.rig_error_px)
    mean[:n], cov[:n, :n] = message.rig_error_px, message.rig_cov_px2.reshape(n, n)
    evidence = np.asarray(getattr(message, "rig_evidence", ()))
    return RigEstimate(
        *(mean, cov, float(message.rig_applied), mean, cov, np.full(len(mean), np.nan)),
        evidence=evidence if len(evidence) else None,
    )
