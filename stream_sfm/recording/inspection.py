"""What is in a log, which pair would be used and why, and whether a replay would work: for `stream-sfm inspect`."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..calibration import read_calibration
from ..errors import LogError
from ..types import StereoFrame, StereoRig
from .calibration_check import check_calibration, findings
from .ground_truth import DEPTH_TOPIC, truth_topic
from .images import GreyScaler, UndecodableImage, decode_grey, image_size
from .pair_reader import PairReader, StereoPair
from .records import Damage, LogFile
from .rig import check_sides
from .stereo_log import choose_cameras, rig_of
from .survey import Survey, survey_log
from .topics import PairChoice, is_rectified

_CHECKED_FRAMES = 5
_LISTED_GAPS = 20


def inspect_log(
    path: str | Path,
    left: str | None = None,
    right: str | None = None,
    calibration: str | Path | StereoRig | None = None,
) -> dict[str, Any]:
    """A description of the log, ready for JSON. The arguments are those of `open_log`.

    `problems` lists what stands in the way of a replay, each with its cure, and is empty where there is none;
    `warnings` what makes it worse. Keys whose content could not be found out are None. Raises LogError only
    where the file is no log at all, ConfigError for a calibration file.
    """
    file = LogFile(path)
    damage = Damage()
    survey = survey_log(file, damage)
    header = file.header()
    problems: list[str] = []
    warnings: list[str] = []
    result: dict[str, Any] = {
        "log": str(path),
        "size_bytes": file.size,
        "profile": header.profile if header else None,
        "library": header.library if header else None,
        "indexed": file.index is not None,
        "complete": damage.complete,
        "duration_s": (survey.end_ns - survey.start_ns) / 1e9 if survey.whole and survey.topics else None,
        "topics": _topics(survey),
        "ground_truth": truth_topic(survey),
        "ground_truth_depth": DEPTH_TOPIC if DEPTH_TOPIC in survey.topics else None,
        "pair": None,
        "images": None,
        "frames": None,
        "rig": None,
        "calibration_check": None,
    }
    choice: PairChoice | None = None
    try:
        choice = choose_cameras(file, survey, left, right)
    except LogError as error:
        problems.append(str(error))
        warnings += damage.notes
    if choice is not None:
        result["pair"] = asdict(choice)
        rig = _rig(file, survey, choice, calibration, problems)
        samples = _read_pairs(file, survey, choice, result, problems, warnings)
        if rig is not None:
            result["rig"] = describe_rig(rig) | {"rectified_images": is_rectified(choice.left)}
            _check(file, rig, samples, result, problems, warnings)
    result["problems"] = _unique(problems)
    result["warnings"] = _unique(warnings)
    return result


def describe_rig(rig: StereoRig) -> dict[str, Any]:
    """Baseline in metres, focal lengths in pixels, vergence in degrees (angle between the optical axes)."""
    vergence = np.degrees(np.arccos(np.clip(rig.right_from_left[2, 2], -1, 1)))
    return {
        "width": rig.left.width,
        "height": rig.left.height,
        "baseline_m": rig.baseline_m,
        "focal_px": [float(rig.left.K[0, 0]), float(rig.right.K[0, 0])],
        "distortion_model": [rig.left.distortion_model, rig.right.distortion_model],
        "D": [list(rig.left.D), list(rig.right.D)],
        "vergence_deg": float(vergence),
        "right_from_left": rig.right_from_left.tolist(),
    }


def _topics(survey: Survey) -> list[dict[str, Any]]:
    span_s = (survey.end_ns - survey.start_ns) / 1e9
    return [
        {
            "topic": t.name,
            "schema": t.schema,
            "encoding": t.encoding,
            "kind": t.kind or None,
            "count": t.count,
            "rate_hz": (t.count - 1) / span_s if t.count and t.count > 1 and span_s > 0 else None,
        }
        for t in sorted(survey.topics.values(), key=lambda t: t.name)
    ]


def _rig(
    file: LogFile,
    survey: Survey,
    choice: PairChoice,
    calibration: str | Path | StereoRig | None,
    problems: list[str],
) -> StereoRig | None:
    try:
        if calibration is None:
            return rig_of(file, survey, choice)
        rig = calibration if isinstance(calibration, StereoRig) else read_calibration(calibration)
        check_sides(file.path, rig)
        return rig
    except LogError as error:
        problems.append(str(error))
        return None


def _read_pairs(
    file: LogFile,
    survey: Survey,
    choice: PairChoice,
    result: dict[str, Any],
    problems: list[str],
    warnings: list[str],
) -> list[StereoPair]:
    """Read all pairs for the figures of time, and keep a few for the check."""
    reader = PairReader(file, choice.left, choice.right)
    expected = survey.topics[choice.left].count or 1
    every = max(1, expected // _CHECKED_FRAMES)
    stamps: list[int] = []
    offsets: list[int] = []
    samples: list[StereoPair] = []
    try:
        for pair in reader.pairs():
            if len(stamps) % every == 0 and len(samples) < _CHECKED_FRAMES:
                samples.append(pair)
            stamps.append(pair.stamp_ns)
            offsets.append(pair.right.stamp_ns - pair.left.stamp_ns)
    except LogError as error:
        problems.append(str(error))
    stats = reader.stats
    result["complete"] = result["complete"] and stats.complete
    warnings += stats.warnings
    frames = {k: v for k, v in asdict(stats).items() if k not in ("warnings", "complete", "bytes_total")}
    periods_s = np.diff(np.array(stamps, dtype=np.int64)) / 1e9
    period_s = float(np.median(periods_s)) if len(periods_s) else None
    frames["rate_hz"] = 1 / period_s if period_s else None
    frames["span_s"] = (stamps[-1] - stamps[0]) / 1e9 if stamps else None
    frames["median_offset_ms"] = float(np.median(offsets)) / 1e6 if offsets else None
    gaps = [i for i in range(len(periods_s)) if period_s and periods_s[i] > 1.6 * period_s]
    frames["gap_count"] = len(gaps)
    frames["gaps"] = [
        {"after_s": (stamps[i] - stamps[0]) / 1e9, "length_s": float(periods_s[i])} for i in gaps[:_LISTED_GAPS]
    ]
    result["frames"] = frames
    if gaps:
        longest = max(float(periods_s[i]) for i in gaps)
        warnings.append(f"{len(gaps)} gaps between stereo frames, the longest {longest:.2f} s")
    offset_ms = frames["median_offset_ms"]
    if offset_ms is not None and period_s and abs(offset_ms) > max(1.0, 20 * period_s):
        warnings.append(
            f"the stamps of right images differ from the left ones by {offset_ms:+.1f} ms: if the cameras are not "
            "triggered together, moving scenes do not fit; if they are, correct the stamps"
        )
    if samples:
        result["images"] = {
            side: {
                "encoding": m.encoding,
                "frame_id": m.frame_id,
                "size": list(size) if (size := image_size(m)) else None,
                "bytes": len(m.data),
            }
            for side, m in (("left", samples[0].left), ("right", samples[0].right))
        }
    return samples


def _check(
    file: LogFile,
    rig: StereoRig,
    samples: list[StereoPair],
    result: dict[str, Any],
    problems: list[str],
    warnings: list[str],
) -> None:
    scaler = GreyScaler()
    frames: list[StereoFrame] = []
    for pair in samples:
        sizes = {image_size(pair.left), image_size(pair.right)}
        calibrated = (rig.left.width, rig.left.height)
        if (wrong := next((s for s in sizes if s is not None and s != calibrated), None)) is not None:
            problems.append(
                f"{file.path}: images are {wrong[0]}×{wrong[1]}, the calibration is for {calibrated[0]}×"
                f"{calibrated[1]} (scale {wrong[0] / calibrated[0]:.3g} × {wrong[1] / calibrated[1]:.3g}): "
                "give the calibration of these images with --calibration FILE"
            )
            return
        try:
            frames.append(
                StereoFrame(pair.stamp_ns, *scaler.to_uint8(decode_grey(pair.left), decode_grey(pair.right)))
            )
        except UndecodableImage as error:
            warnings.append(f"an image cannot be decoded: {error}")
    if samples and not frames:
        problems.append(f"{file.path}: none of {len(samples)} sampled image pairs can be decoded")
    check = check_calibration(rig, frames)
    result["calibration_check"] = {k: None if v != v else v for k, v in asdict(check).items()}  # NaN is no JSON
    more_problems, more_warnings = findings(rig, check)
    problems += [f"{file.path}: {p}" for p in more_problems]
    warnings += more_warnings


def _unique(texts: list[str]) -> list[str]:
    return list(dict.fromkeys(texts))
