"""`stream-sfm inspect`: what a log contains, and whether it can be replayed."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..errors import ExitCode, StreamSfmError
from ..system.wording import counted
from . import options
from .printing import broken_at, number, output_width, print_json, print_notes, print_table

_MAX_TOPICS = 200  # shown; --json lists all
_FRAMES = 60  # that are estimated: in some seconds most cameras turn


def inspect(
    log: options.Recording,
    /,
    *,
    report: options.ResultFile = None,
    cameras: options.Cameras = options.Cameras(),
    json: options.Json = False,
) -> int:
    """Show what a log contains and check whether it can be replayed.

    Shows the topics of a log, the stereo pair that would be used and why, frame rate, gaps and calibration, and checks
    the calibration against the images: the rows of matched corners; and lens errors, focal length, right-camera delay
    and shutter readout, as estimated from the first frames. The last line is the verdict on the calibration. An IMU is
    checked for rate and gaps, and against the images for its clock, axes, biases and noise. If a replay cannot work,
    the exit code is 3 and the output says what to change.

    Args:
        report: write a page (HTML) about the calibration: rows and disparity over the image, each error with its σ; if
            the calibration is refined, without and with the refinement
    """
    from ..inspection.overview import inspect_log

    options.protect([report], log, cameras.calibration)
    found = inspect_log(log, **cameras.chosen)
    _add_first_frames(found, log, cameras)
    if report is not None and not found["problems"]:
        _write_page(log, report, cameras)
    if json:
        print_json(found)
    else:
        _print(found, log, cameras)
    return ExitCode.INPUT if found["problems"] else ExitCode.DONE


def _add_first_frames(found: dict[str, Any], log: str, cameras: options.Cameras) -> None:
    """Add what the first frames show of the rig and of the IMU, and the verdict on the calibration."""
    from ..logs.recording.stereo_log import open_log
    from ..report.verdict import Fit, judged
    from ..run import replay
    from ..types import Selection

    found["rig_errors"] = found["verdict"] = None
    if found["problems"]:
        if found["rig"] is not None:
            found["verdict"] = {"fit": str(Fit.WRONG), "text": f"wrong: {found['problems'][0]}"}
        return
    try:
        opened = open_log(log, **cameras.chosen)
        look = replay.replay(opened, selection=Selection(max_frames=_FRAMES)).summary
        found["rig_errors"] = look.get("rig")
        found["verdict"] = judged(look)
        found["warnings"] += filter(None, [opened.imu_problem])
        if found["imu"] is not None:
            found["imu"]["first_frames"] = look["imu"]
            found["warnings"] += look["imu"]["findings"] if look["imu"] else []
    except StreamSfmError as error:
        found["problems"].append(f"the first frames cannot be estimated: {error}")
        found["verdict"] = judged({})


def _print(found: dict[str, Any], log: str, cameras: options.Cameras) -> None:
    headings = ("topic", "schema", "kind", "messages", "rate")
    print_table(_topics(found), headings, title=found["log"], text_columns=3)
    if (more := len(found["topics"]) - _MAX_TOPICS) > 0:
        print(f"and {more} more topics")
    print_table(_facts(found))
    print_notes("warning", found["warnings"], stderr=False)
    print_notes("problem", found["problems"], stderr=False)
    if not found["problems"]:
        print("this log can be replayed")
    if (verdict := found["verdict"]) is not None:
        if verdict["fit"] in ("wrong", "corrected") and not found["problems"]:
            given = ["--calibration", *map(str, cameras.calibration)] if cameras.calibration else []
            command = shlex.join(["stream-sfm", "refine", str(log), *given, "--out", "refined.toml"])
            print(f"to refine it: {command}")
        print(f"calibration: {verdict['text']}")


def _write_page(log: str, file: str, cameras: options.Cameras) -> None:
    """Write the page about the calibration of a log; before and after, if there is something before it."""
    from ..config import Config
    from ..logs.recording.stereo_log import open_log
    from ..report.rig_page import render_rig
    from ..run.looks import calibrations, look
    from ..system.files import write_whole
    from ..types import Selection

    first_frames = Selection(max_frames=_FRAMES)
    runs = []
    for title, calibration in calibrations(log, cameras.chosen):
        opened = open_log(log, **(cameras.chosen | {"calibration": calibration}))
        runs.append(look(opened, Config(), first_frames).as_run(title))
    write_whole(Path(file), render_rig(log, runs, Config()).encode())


def _topics(found: dict[str, Any]) -> Iterator[list[str]]:
    width = max(16, (output_width() - 44) // 2)  # 44: the columns of numbers and all borders
    for t in found["topics"][:_MAX_TOPICS]:
        rate = f"{t['rate_hz']:.1f} Hz" if t["rate_hz"] else ""
        names = (broken_at(text, "/._", width) for text in (t["topic"], t["schema"] or "–"))
        yield [*names, t["kind"] or "", "" if t["count"] is None else str(t["count"]), rate]


def _facts(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    whole = "complete" if found["complete"] else "damaged or cut off"
    index = "indexed" if found["indexed"] else "without an index"
    length = f", {found['duration_s']:.2f} s" if found["duration_s"] is not None else ""
    files = f" in {found['files']} files" if found.get("files", 1) > 1 else ""
    yield "recording", f"{found['format']}{files}, {found['size_bytes'] / 1e6:.2f} MB, {whole}, {index}{length}"
    if pair := found["pair"]:
        yield "stereo pair", f"{pair['left']} and {pair['right']}: {pair['reason']}"
    if images := found["images"]:
        kinds = (f"{'×'.join(map(str, i['size'] or '?'))} {i['encoding']}" for i in images.values())
        yield "images", " and ".join(dict.fromkeys(kinds))
    if frames := found["frames"]:
        rate = f" at {frames['rate_hz']:.2f} Hz" if frames["rate_hz"] else ""
        exactly, offset = frames["paired_exactly"], number(frames["median_offset_ms"])
        yield "stereo frames", f"{frames['paired']}{rate}, {exactly} with equal stamps, median offset {offset} ms"
        yield "unpaired", f"{frames['unpaired_left']} left and {frames['unpaired_right']} right images"
        few = 5  # more would hide the rest of the table
        gaps = [f"{g['length_s']:.2f} s after {g['after_s']:.2f} s" for g in frames["gaps"][:few]]
        more = frames["gap_count"] - few
        yield "gaps", "; ".join(gaps) + (f" and {more} more" if more > 0 else "") if gaps else "none"
    if rig := found["rig"]:
        kind = "rectified" if rig["rectified_images"] else "unrectified"
        refined = rig["refined_by_px"]
        by = "" if refined is None else f"; refined by {refined:.2f} px of disparity"
        yield "calibration", f"{rig['source']}; for {kind} images{by}"
        lengths = f"baseline {rig['baseline_m']:.4f} m, focal length {rig['focal_px'][0]:.1f} px"
        yield "rig", f"{lengths}, vergence {rig['vergence_deg']:.2f}°, distortion {rig['distortion_model'][0]}"
    check = found["calibration_check"]
    if check and check["vertical_px"] is not None:
        rows = f"vertical difference {check['vertical_px']:+.2f} ± {check['vertical_spread_px']:.2f} px"
        disparity = f"median disparity {check['median_disparity_px']:.1f} px"
        yield "calibration check", f"{check['matches']} matched corners: {rows}, {disparity}"
    if imu := found.get("imu"):
        yield from _inertial_facts(imu)
    depth = f", depth on {found['ground_truth_depth']}" if found["ground_truth_depth"] else ""
    yield "ground truth", f"{found['ground_truth'] or 'none'}{depth}"


def _inertial_facts(imu: dict[str, Any]) -> Iterator[tuple[str, str]]:
    rate = f" at {imu['rate_hz']:.0f} Hz" if imu["rate_hz"] else ""
    force = f", specific force {imu['specific_force_m_s2']:.2f} m/s²" if imu["specific_force_m_s2"] else ""
    seen = f"{counted(imu['samples'], 'sample')}{rate}, {counted(imu['gap_count'], 'gap')}{force}"
    yield "IMU", f"{' and '.join(imu['topics'])}: {seen}"
    if first := imu.get("first_frames"):
        from ..report.inertia import inertial_rows

        yield from inertial_rows(first)
