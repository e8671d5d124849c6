"""The content of a log, which pair would be used and why, and whether a replay would work."""

from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.calibration.document import Where
from ..camera.models import MAX_PIXELS
from ..camera.pixels import GreyScaler
from ..camera.refinement import disparity_rms_px
from ..camera.rig import StereoRig, baseline_warnings
from ..errors import LogError, StreamSfmError
from ..logs.mcap_file.message import Damage, Source
from ..logs.recording.beside import calibration_beside, note_of
from ..logs.recording.both_sides import both_sides
from ..logs.recording.ground_truth import depth_topic, read_truth, truth_topic
from ..logs.recording.images import UndecodableImage, decode_grey, image_size
from ..logs.recording.messages import ImageMessage
from ..logs.recording.pair_reader import PairReader, StereoPair
from ..logs.recording.pairing import gaps_after
from ..logs.recording.rig import check_rig, find_rig, right_is_left
from ..logs.recording.stereo_log import choose_cameras
from ..logs.recording.survey import Survey, survey_log
from ..logs.recording.topics import PairChoice, is_rectified
from ..logs.recording.video_topics import with_videos
from ..logs.sources.joined import JoinedSource
from ..logs.sources.recognise import open_source
from ..pictures.interlacing import is_interlaced
from ..pipeline.engine import Engine
from ..system.wording import LISTED
from ..types import StereoFrame
from .calibration_check import (
    calibration_findings,
    check_calibration,
    images_of,
    matched_corners,
    size_problem,
    stamp_warning,
    well_followed,
)
from .unit_check import check_unit

_CHECKED_PLACES = 4  # spread over the log; at each, two consecutive frames are examined
_KEPT_BYTES = 256 * 2**20  # for stored images, recorded and decoded; fewer large images are examined


def inspect_log(
    path: str | Path,
    left: str | None = None,
    right: str | None = None,
    calibration: Where | StereoRig | None = None,
    rate_hz: float | None = None,
) -> dict[str, Any]:
    """Describe a log, ready for JSON. The arguments are those of `open_log`.

    `problems` lists what prevents a replay, each with its fix; `warnings` what makes it worse. Unknown values are
    None. Raises LogError only if the path is not a recording, ConfigError for a calibration.
    """
    inspection = _Inspection(open_source(path, calibration is not None, rate_hz))
    inspection.run(left, right, calibration)
    return {
        "log": str(path),
        **inspection.result,
        "problems": list(dict.fromkeys(inspection.problems)),
        "warnings": list(dict.fromkeys(inspection.warnings)),
    }


def describe_rig(rig: StereoRig) -> dict[str, Any]:
    """Describe a rig: baseline in metres, focal lengths in pixels, angle between the optical axes in degrees.

    `refined_by_px`: root mean square of the known disparity error, if the calibration was refined.
    """
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
        "refined_by_px": None if rig.refinement is None else disparity_rms_px(rig.refinement.error_px),
    }


class _Inspection:
    """One inspection of a log, which collects its findings in `result`, `problems` and `warnings`."""

    def __init__(self, source: Source) -> None:
        self.problems: list[str] = []
        damage = Damage()
        self.source, self.survey = with_videos(source, survey_log(source, damage))
        survey = self.survey
        self.warnings = list(damage.notes)
        self.result: dict[str, Any] = {
            "size_bytes": source.size_bytes,
            "format": source.format,
            "profile": source.profile,
            "library": source.library,
            "indexed": source.indexed,
            **({"files": source.files} if isinstance(source, JoinedSource) else {}),
            "complete": damage.complete,
            "duration_s": (survey.end_ns - survey.start_ns) / 1e9 if survey.whole and survey.topics else None,
            "topics": _topics(survey),
            "ground_truth": truth_topic(survey),
            "ground_truth_depth": depth_topic(survey),
            "pair": None,
            "images": None,
            "frames": None,
            "rig": None,
            "calibration_check": None,
            "imu": None,
        }

    def run(self, left: str | None, right: str | None, calibration: Where | StereoRig | None) -> None:
        """Find the pair, its frames and its calibration, and check whether they fit each other."""
        try:
            if calibration is None and (beside := calibration_beside(self.source, self.survey, mono=False)):
                calibration = beside
                self.warnings.append(note_of(beside))
            self.source, self.survey, calibration = both_sides(self.source, self.survey, calibration)
            choice = choose_cameras(self.source, self.survey, left, right)
        except LogError as error:
            self.problems.append(str(error))
            return
        self.result["pair"] = asdict(choice)
        rig: StereoRig | None = None
        try:
            found = find_rig(self.source, self.survey, choice, calibration, mono=False)
            assert isinstance(found.rig, StereoRig)
            rig = found.rig
            facts = {"source": found.origin, "rectified_images": is_rectified(choice.left)}
            self.result["rig"] = facts | describe_rig(rig)
            self.warnings += baseline_warnings(rig)
        except LogError as error:
            self.problems.append(str(error))
        pairs = self._read_pairs(choice)
        self._check_truth()
        self._check_unit()
        if rig is not None and self._sizes_fit(rig, pairs):
            self._check(rig, choice, pairs)

    def _read_pairs(self, choice: PairChoice) -> list[StereoPair]:
        """Read all pairs for rate and gaps; returns a few of them, two at each place."""
        reader = PairReader(self.source, choice.left, choice.right)
        every = max(2, (self.survey.topics[choice.left].count or 1) // _CHECKED_PLACES)
        stamps_ns: list[int] = []
        offsets_ns: list[int] = []
        kept: list[StereoPair] = []
        kept_bytes = 0
        try:
            for pair in reader.pairs():
                place, within = divmod(len(stamps_ns), every)
                if within < 2 and place < _CHECKED_PLACES:
                    kept_bytes += sum(map(_held_bytes, pair.images))
                    if not stamps_ns or kept_bytes <= _KEPT_BYTES:
                        kept.append(pair)
                stamps_ns.append(pair.stamp_ns)
                offsets_ns.append(pair.right.stamp_ns - pair.left.stamp_ns)
        except LogError as error:
            self.problems.append(str(error))
        self.result["complete"] = self.result["complete"] and reader.stats.complete
        self.warnings += reader.stats.warnings
        counts = {k: v for k, v in asdict(reader.stats).items() if k not in ("warnings", "complete", "bytes_total")}
        self.result["frames"] = counts | _timing(stamps_ns, offsets_ns)
        if gaps := self.result["frames"]["gap_count"]:
            longest_s = self.result["frames"]["longest_gap_s"]
            self.warnings.append(f"{gaps} gaps between stereo frames, the longest {longest_s:.2f} s")
        if kept:
            left, right = map(_describe_image, kept[0].images)
            self.result["images"] = {"left": left, "right": right}
        return kept

    def _check_truth(self) -> None:
        """Warn if the ground truth cannot be used."""
        topic, images = self.result["ground_truth"], self.result["images"]
        if topic is None or images is None:
            return
        try:
            read_truth(self.source, topic, images["left"]["frame_id"], self.warnings)
        except LogError as error:
            self.warnings.append(f"ground truth cannot be read: {error}")

    def _check_unit(self) -> None:
        """Look at the samples of the inertial unit, if there is one."""
        try:
            check = check_unit(self.source, self.survey)
        except LogError as error:
            self.warnings.append(f"the IMU cannot be read: {error}")
            return
        if check is not None:
            self.result["imu"] = asdict(check)
            self.warnings += check.warnings()

    def _sizes_fit(self, rig: StereoRig, pairs: list[StereoPair]) -> bool:
        for message in chain.from_iterable(pair.images for pair in pairs):
            size = image_size(message)
            if size is not None and (problem := size_problem(size, rig)) is not None:
                self.problems.append(f"{self.source.path}: topic {message.topic}: {problem}")
                return False
        return True

    def _check(self, rig: StereoRig, choice: PairChoice, pairs: list[StereoPair]) -> None:
        """Compare the calibration with the images."""
        decoded = list(self._decoded(pairs))
        if pairs and not decoded:
            self.problems.append(f"{self.source.path}: none of the sampled image pairs can be decoded")
        images = [images_of(frame) for frame in decoded]
        if any(all(map(is_interlaced, pair)) for pair in images):
            self.problems.append(
                f"{self.source.path}: the images are interlaced: their odd and even rows were exposed at different "
                "times; record progressive video"
            )
        corners = [matched_corners(*pair) for pair in images]
        check = check_calibration(rig, corners)
        self.result["calibration_check"] = {k: None if v != v else v for k, v in asdict(check).items()}  # no NaN
        # of exchanged sides the images show which are wrong
        if right_is_left(rig) is None or np.isnan(check.negative_share):
            try:
                check_rig(self.source, rig)
            except LogError as error:
                self.problems.append(str(error))
                return
        frames = self.result["frames"]
        if frames["median_offset_ms"] and frames["rate_hz"]:
            warning = stamp_warning(frames["median_offset_ms"], 1e3 / frames["rate_hz"], choice.right)
            self.warnings += [warning] if warning else []
        problems, warnings = calibration_findings(rig, check, corners, choice, partial(_is_followed, rig, decoded))
        self.warnings += warnings
        self.problems += [f"{self.source.path}: {problem}" for problem in problems]

    def _decoded(self, pairs: list[StereoPair]) -> Iterator[StereoFrame]:
        scaler = GreyScaler()
        for pair in pairs:
            try:
                left, right = scaler.to_uint8(decode_grey(pair.left), decode_grey(pair.right))
            except UndecodableImage as error:
                self.warnings.append(f"an image cannot be decoded: {error}")
            else:
                yield StereoFrame(pair.stamp_ns, left, right)


def _is_followed(rig: StereoRig, frames: list[StereoFrame]) -> bool:
    """Whether an engine tracks well those of these frames that follow another one."""
    try:
        engine = Engine(rig)
        return well_followed([engine.step(frame).status for frame in frames])
    except StreamSfmError:
        return False


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


def _timing(stamps_ns: list[int], offsets_ns: list[int]) -> dict[str, Any]:
    """Return rate and gaps of the pairs, and the median offset of the right stamps from the left ones."""
    periods_s = np.diff(np.array(stamps_ns, dtype=np.int64)) / 1e9
    period_s = float(np.median(periods_s)) if len(periods_s) else None
    gaps = gaps_after(stamps_ns)
    return {
        "rate_hz": 1 / period_s if period_s else None,
        "span_s": float(periods_s[periods_s > 0].sum()) if stamps_ns else None,
        "median_offset_ms": float(np.median(offsets_ns)) / 1e6 if offsets_ns else None,
        "gap_count": len(gaps),
        "longest_gap_s": float(max(periods_s[gaps])) if gaps else None,
        "gaps": [
            {"after_s": (stamps_ns[i] - stamps_ns[0]) / 1e9, "length_s": float(periods_s[i])} for i in gaps[:LISTED]
        ],
    }


def _held_bytes(message: ImageMessage) -> int:
    """Return the memory of an image as recorded and as grey, bytes."""
    width, height = image_size(message) or (0, 0)
    return len(message.data) + min(width * height, MAX_PIXELS)


def _describe_image(message: ImageMessage) -> dict[str, Any]:
    size = image_size(message)
    return {
        "encoding": message.encoding,
        "frame_id": message.frame_id,
        "size": list(size) if size else None,
        "bytes": len(message.data),
    }
