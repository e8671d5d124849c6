"""Factors of σ are recovered from motions whose errors are too large, over spans within the window and longer ones."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stream_sfm.evaluation.relative_consistency import SPANS, RelativeRecord, against_truth, factors
from stream_sfm.evaluation.summary import end_pose
from stream_sfm.geometry import se3
from stream_sfm.types import CommonErrors, RelativeMotions, Trajectory

FRAMES, PERIOD_NS = 420, 100_000_000
STEP = se3.exp([0.1, 0.0, 0.02, 0.0, 0.01, 0.0])
STD = np.repeat([1e-3, 2e-4], 3)  # of one step


def record_of(estimated: np.ndarray, cov: np.ndarray, missing: range = range(0)) -> RelativeRecord:
    """Motions over 1 … 8 frames of an estimated path whose steps are independent, with `cov` (6, 6) each."""
    record = RelativeRecord()
    for n in (n for n in range(len(estimated)) if n not in missing):
        motions, covs = [np.eye(4)], [np.zeros((6, 6))]
        for i in range(n - 1, max(n - 9, -1), -1):  # one step more, at the far end of the motion
            step, ad = se3.inverse(estimated[i]) @ estimated[i + 1], se3.adjoint(se3.inverse(motions[-1]))
            motions.append(step @ motions[-1])
            covs.append(covs[-1] + ad @ cov @ ad.T)
        spans = np.arange(1, len(motions))
        relative = RelativeMotions(n - spans, np.stack(motions[1:]), np.stack(covs[1:])) if n else None
        record.add(at(n, relative))
    return record


def at(n: int, relative: RelativeMotions | None, common: CommonErrors | None = None) -> Any:
    """What a record reads of the estimate of a frame."""
    return SimpleNamespace(stamp_ns=n * PERIOD_NS, frame_index=n, status="ok", relative=relative, common=common)


@pytest.mark.parametrize("too_small", [1.0, 3.0])
def test_the_factor_is_the_excess_of_the_errors(too_small: float) -> None:
    """Steps err independently; over long spans few of them are independent, the standard error grows with it."""
    rng = np.random.default_rng(2)
    path, estimated = [np.eye(4)], [np.eye(4)]
    for _ in range(FRAMES - 1):
        path.append(path[-1] @ STEP)
        estimated.append(estimated[-1] @ STEP @ se3.exp(too_small * STD * rng.normal(size=6)))
    truth = Trajectory(np.arange(FRAMES) * PERIOD_NS, np.stack(path))
    found = against_truth(record_of(np.stack(estimated), np.diag(STD**2)), truth, (0.0, 0.0))
    assert [spans["frames"] for spans in found] == list(SPANS)
    for spans in found:
        standard_error = too_small * np.sqrt(spans["frames"] / (2 * 6 * FRAMES))
        assert abs(spans["factor"] - too_small) < 4 * standard_error
        assert spans["count"] == FRAMES - spans["frames"]
        # own errors are all there are; of every second frame, as more than 300 are too many to keep
        assert abs(spans["factor_own"] - too_small) < 4 * np.sqrt(2) * standard_error
        assert spans["factor_common"] is None


def test_covariances_of_added_motions_with_common_errors_are_right() -> None:
    """Over 100 frames, of motions over eight and two frames: errors c that become known on the way, with what was last
    known of them, are in all alike; as if motions were independent, σ is far too small."""
    rng, trials = np.random.default_rng(4), 150
    ends = [begin + k for begin in range(0, 100, 20) for k in (2, 10, 12, 20)]
    by_c = np.zeros((6, 2))
    by_c[2, 0], by_c[4, 1] = 3e-2, 6e-3  # of a motion: a share of its length, and a turn
    apart: dict[bool, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {True: [], False: []}
    for _ in range(trials):
        c, information, weighted = rng.normal(size=2), np.eye(2), np.zeros(2)
        records = {shared: RelativeRecord() for shared in apart}
        for before, n in pairwise([0, *ends]):
            information, weighted = information + np.eye(2), weighted + c + rng.normal(size=2)
            cov_c = np.linalg.inv(information)
            common = CommonErrors(cov_c @ weighted, cov_c, np.zeros((6, 2)))
            error = by_c @ (c - common.mean) + STD * rng.normal(size=6)
            motion = np.linalg.matrix_power(STEP, n - before) @ se3.exp(-error)
            cov = np.diag(STD**2) + by_c @ cov_c @ by_c.T
            relative = RelativeMotions(np.array([before]), motion[None], cov[None], by_c[None])
            records[True].add(at(n, relative, common))
            records[False].add(at(n, relative))
        for shared, record in records.items():
            found = record.motions(100)
            pose = found.earlier_from_end[-1]
            error = se3.log(se3.inverse(pose) @ np.linalg.matrix_power(STEP, 100))
            apart[shared].append((error, found.cov[-1], pose))
    right, wrong = (factors(*map(np.stack, zip(*apart[shared], strict=True)))["factor"] for shared in (True, False))
    assert right == pytest.approx(1, abs=4 / np.sqrt(2 * 6 * trials))
    assert wrong > 1.6


def test_frames_that_a_damaged_file_lacks_shift_nothing() -> None:
    path = np.stack([np.linalg.matrix_power(STEP, n) for n in range(FRAMES)])
    truth = Trajectory(np.arange(FRAMES) * PERIOD_NS, path)
    found = against_truth(record_of(path, np.diag(STD**2), range(100, 120)), truth, (0.0, 0.0))
    assert max(spans["factor"] for spans in found) < 1e-6  # rounding: the estimates are exact
    assert found[0]["count"] == FRAMES - 20 - 2  # nor has the first frame one, or the first one behind the gap


def test_the_truth_s_own_error_counts() -> None:
    """Nearly exact estimates against a noisy truth: without its σ they look wrong, with it right."""
    rng = np.random.default_rng(3)
    path = np.stack([np.linalg.matrix_power(STEP, n) for n in range(FRAMES)])
    noisy = path @ se3.exp(rng.normal(size=(FRAMES, 6)) * np.repeat([0.01, 0.002], 3))
    truth = Trajectory(np.arange(FRAMES) * PERIOD_NS, noisy)
    record = record_of(path, np.diag(STD**2))
    blind, seeing = (against_truth(record, truth, std)[0]["factor"] for std in ((0.0, 0.0), (0.01, 0.002)))
    assert blind > 5  # the truth errs by 14 σ
    assert seeing == pytest.approx(1, abs=4 * np.sqrt(2 / (2 * 6 * FRAMES)))  # neighbouring spans share a truth


def test_a_length_is_judged_along_the_motion() -> None:
    poses = np.broadcast_to(se3.exp([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]), (50, 4, 4))
    error = np.zeros((50, 6))
    error[:, 2] = 0.02
    found = factors(error, np.broadcast_to(np.diag(np.repeat([1e-4, 1e-6], 3)), (50, 6, 6)), poses)
    assert found["factor_length"] == pytest.approx(2)
    assert found["factor_axes"] == pytest.approx([0, 0, 2, 0, 0, 0])


def test_the_end_is_reported_with_its_uncertainty() -> None:
    turned = se3.exp([0, 0, 0, 0, np.radians(30), 0])
    turned[:3, 3] = (3, 0, 4)
    cov = np.diag([0.01, 0.02, 0.02, 1e-4, 4e-4, 1e-4])
    end = end_pose(Trajectory(np.array([0, 1]), np.stack([np.eye(4), turned]), np.stack([np.zeros((6, 6)), cov])))
    assert end is not None
    assert end["heading_deg"] == pytest.approx(30)
    assert end["std_heading_deg"] == pytest.approx(np.degrees(0.02))
    assert end["std_position_m"] == pytest.approx(np.sqrt(0.05))
    assert end["std_position_percent"] == pytest.approx(100 * np.sqrt(0.05) / 5)
