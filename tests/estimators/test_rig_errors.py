"""A wrong or an exact calibration: the errors that the window finds, and the consistency of its covariances."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from stream_sfm.camera.refinement import LENS_TERMS, KnownTiming, Refinement
from stream_sfm.config import Config, RigConfig, WindowConfig
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.window.cross_frame import CrossFrame
from stream_sfm.estimators.window.rig_state import RigState
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.model import RigModel
from stream_sfm.rig_model.terms import AT_TIMING, AT_TURNING, FOCAL, TERMS
from stream_sfm.simulation.scenes import MOTIONS, Scene, Sequence
from stream_sfm.types import Observations, RigView, Solution
from tests.helpers.estimators import nees, run
from tests.helpers.rectified import own_rows

STD_PX = 0.15
TRIALS = 8
SCENE = Scene(frames=26, track_length=13, visible=90, std_px=STD_PX, round_off=False)
LENS = slice(0, TERMS.index(FOCAL))
M = TERMS.index(FOCAL)
# σ; the effects of lens errors of several pixels are not linear
TYPICAL = np.array([1.0] * 6 + [0.15] * (M - 7) + [1.0])


def seen(sequence: Sequence, errors: Array) -> list[Observations]:
    """Observations of the scene by a rig with errors (M,) of lenses, in units of their σ."""
    model = RigModel.of(sequence.projection, RigConfig())
    return [
        replace(o, z_px=o.z_px + model.effects(o.z_px)[..., LENS] @ errors, rig=RigView(model))
        for o in sequence.observations
    ]


def last(sequence: Sequence, observations: list[Observations], exact: bool = False) -> Solution:
    return run("cross-frame", sequence.projection, [replace(o, rig=None) if exact else o for o in observations])[-1]


def nees_at(solution: Solution, world_from_cam: Array) -> float:
    return nees(solution.world_from_cam, solution.cov_pose, world_from_cam)


def trials(scene: Scene, count: int, size: Array) -> list[tuple[Sequence, list[Observations], Array]]:
    """Sequences, their observations, and the errors (M,) of the lenses, of σ `size`."""
    result = []
    for seed in range(count):
        sequence = scene.sequence(np.random.SeedSequence(seed))
        true = size * np.random.default_rng(seed).normal(size=M)
        result.append((sequence, seen(sequence, true), true))
    return result


@pytest.mark.slow
def test_a_wrong_calibration_is_found_within_its_sigma_and_the_pose_stays_consistent() -> None:
    """σ of the errors found and of the last pose is right to a factor of 1.4; in a window that treats the calibration
    as exact it is 4 to 50 times too small."""
    of_rig, of_pose, blind = [], [], []
    for sequence, observations, true in trials(SCENE, TRIALS, TYPICAL):
        solution = last(sequence, observations)
        assert isinstance(solution.rig, RigEstimate) and solution.rig.applied
        away = solution.rig.mean[LENS] - true
        of_rig.append(away @ np.linalg.solve(solution.rig.cov[LENS, LENS], away))
        of_pose.append(nees_at(solution, sequence.world_from_cam[-1]))
        if len(blind) < 3:  # enough to show the effect
            blind.append(nees_at(last(sequence, observations, exact=True), sequence.world_from_cam[-1]))
    assert 0.7 < np.sqrt(np.mean(of_rig) / M) < 1.4
    assert 0.7 < np.sqrt(np.mean(of_pose) / 6) < 1.4
    assert np.sqrt(np.min(blind) / 6) > 4


@pytest.mark.slow
def test_noise_of_the_views_is_not_taken_for_an_error_of_the_rig() -> None:
    """Effects are evaluated at fitted positions: at measured ones noise adds up, to 1.1 σ of weakly visible errors."""
    count, away = 8, []
    for sequence, observations, true in trials(replace(SCENE, track_length=8, visible=48), count, TYPICAL):
        rig = last(sequence, observations).rig
        assert rig is not None
        away.append((rig.mean[LENS] - true) / np.sqrt(np.diag(rig.cov))[LENS])
    terms = [TERMS.index("1"), TERMS.index("xx"), TERMS.index("radial 5")]
    assert (np.abs(np.mean(away, axis=0)[terms]) < 3 / np.sqrt(count)).all()


def test_an_exact_calibration_is_not_harmed() -> None:
    """Improbable errors hardly move the estimate, and their possible size is part of its covariance."""
    harm = []
    for sequence, observations, _ in trials(SCENE, 9, np.zeros(M)):
        considered, exact = last(sequence, observations), last(sequence, observations, exact=True)
        assert considered.rig is not None and not considered.rig.applied
        assert exact.rig is None
        difference = se3.log(se3.inverse(exact.world_from_cam) @ considered.world_from_cam)
        # both are linearised at their own estimates
        assert (np.diag(considered.cov_pose) > 0.98 * np.diag(exact.cov_pose)).all()
        harm.append((difference**2 / np.diag(exact.cov_pose)).mean())
    assert np.median(harm) < 0.1**2
    assert np.mean(harm) < 0.2**2  # a mixture moves estimates a little: a fifth of a σ costs 2 % of RMS accuracy


class Flight:
    """A smooth path in front of points, with a late right camera, and shutters that read out row by row."""

    P = StereoProjection(600.0, 256.0, 256.0, 240.0, 0.25, 512, 480)
    PERIOD_S, row_of, std_px = 0.05, own_rows(P), STD_PX

    def __init__(self, seed: int, delay_s: float, readout_s: float, frames: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.delay_s, self.readout_s, self.frames = delay_s, readout_s, frames
        depth_m = self.rng.uniform(2, 6, 200)
        self.points = np.c_[self.rng.uniform([-0.7, -0.5], [0.7, 0.5], (200, 2)) * depth_m[:, None], depth_m]

    def world_from_cam(self, seconds: Array) -> Array:
        """Poses (n, 4, 4) at times (n,): half a metre per second, and 30° per second, that change in half a second."""
        rates = np.array([2.0, 3.1, 2.5, 4.0, 3.4, 2.2])
        return se3.exp(np.array([0.3, 0.2, 0.15, 0.08, 0.12, 0.1]) * np.sin(np.multiply.outer(seconds, rates)))

    def views(self, seconds: Array) -> Array:
        """Views (n, 4) of all points, each coordinate at its own time (n, 4)."""
        z_px = np.empty(seconds.shape)
        for k in range(4):
            in_cam = se3.transform(se3.inverse(self.world_from_cam(seconds[:, k])), self.points[:, None])[:, 0]
            z_px[:, k] = self.P.project(in_cam)[:, k]
        return z_px

    def observations(self) -> list[Observations]:
        """Views with noise `std_px`, and a model without prior knowledge of the timing."""
        model, result = RigModel.of(self.P, RigConfig(), row_of=self.row_of), []
        late = self.delay_s * np.array([0.0, 0.0, 1.0, 1.0])
        for n in range(self.frames):
            z_px = self.views(np.full((len(self.points), 4), n * self.PERIOD_S))
            for _ in range(3):  # the row of a view depends on its time; each step leaves a hundredth
                seconds = n * self.PERIOD_S + self.readout_s * self.row_of(z_px)
                z_px = self.views(seconds + late)
            z_px[:, 3] = self.views(seconds)[:, 3]  # without the effect of a delay on the rows
            ids = np.flatnonzero(((z_px > 0) & (z_px < (512, 480, 512, 480))).all(axis=1))
            z_px = z_px[ids] + self.std_px * self.rng.normal(size=(len(ids), 4))
            cov = np.broadcast_to(self.std_px**2 * np.eye(4), (len(ids), 4, 4))
            stamp_ns = round(n * self.PERIOD_S * 1e9)
            result.append(Observations(n, stamp_ns, ids, z_px, cov, rig=RigView(model)))
        return result


@pytest.mark.slow
@pytest.mark.parametrize(("delay_ms", "readout_ms"), [(8, 0), (2, 20)])
def test_delay_and_readout_are_estimated_from_a_moving_camera_and_poses_stay_consistent(
    delay_ms: float, readout_ms: float
) -> None:
    """Four flights of 24 frames: of eight normalised errors of timing none is beyond 4, and the mean NEES of the last
    poses is below the percentile of χ² that chance exceeds once in 2000."""
    of_pose = []
    for seed in range(4):
        flight = Flight(seed, delay_ms / 1e3, readout_ms / 1e3, 24)
        observations = flight.observations()
        solution = run("cross-frame", flight.P, observations)[-1]
        assert solution.rig is not None and observations[0].rig is not None
        mean, cov = observations[0].rig.model.timing(solution.rig)
        std = np.sqrt(np.diag(cov))
        of_pose.append(nees_at(solution, flight.world_from_cam(np.array([23 * flight.PERIOD_S]))[0]))
        assert (np.abs(mean - (flight.delay_s, flight.readout_s)) < 4 * std).all()
        assert (std < (5e-4, 1e-3)).all()
    assert np.sum(of_pose) < chi2.ppf(1 - 5e-4, 6 * len(of_pose))


class Carried(Flight):
    """A camera in a hand, which turns by 40° per second and begins to nod by as much; its views have little noise."""

    std_px = 0.03

    def world_from_cam(self, seconds: Array) -> Array:
        """Poses (n, 4, 4) at times (n,)."""
        sizes, rates = np.array([0.25, 0.08, 0.3, 0.11, 0.14, 0.02]), np.array([2.5, 2.5, 2.5, 6.0, 5.0, 4.0])
        return se3.exp(sizes * np.sin(np.multiply.outer(seconds, rates) - [0, 0, 0, np.pi / 2, 0, 0]))


def test_while_a_readout_is_not_known_a_camera_that_turns_loses_neither_its_views_nor_its_way() -> None:
    """The velocities of the first frames are extrapolated, which moves all views of a frame alike, by some pixels.

    Where each view errs by itself, most are rejected, and poses are wrong by up to 150 mm.
    """
    for seed in range(4):
        flight = Carried(seed, 0.0, 0.022, 8)
        observations = flight.observations()
        true = flight.world_from_cam(np.arange(8) * flight.PERIOD_S)
        solutions = run("cross-frame", flight.P, observations)
        for n in range(3, 8):
            off = se3.inverse(solutions[n].world_from_cam) @ se3.inverse(true[0]) @ true[n]
            assert len(solutions[n].track_ids) > 0.3 * len(observations[n].track_ids)
            assert np.linalg.norm(off[:3, 3]) < 0.01


def test_the_error_of_a_twist_is_an_unknown_only_until_the_readout_is_known() -> None:
    """A smooth flight needs it in two frames; it ends once no view of the window shows it."""
    flight = Flight(0, 0.0, 0.0, 24)
    estimator, unknowns = CrossFrame(flight.P, Config()), []
    for o in flight.observations():
        estimator.step(o)
        assert estimator.map is not None
        unknowns.append(estimator.map.own.shape[1])
    assert max(unknowns) == unknowns[0] + 6
    assert unknowns[-1] == unknowns[0]
    assert estimator.map is not None and not estimator.map.exposures.has_twist


def zoomed(flight: Flight, longer: Array, off_px: float = 0.0) -> list[Observations]:
    """Observations of a flight with focal lengths `longer` (n,) times the calibrated ones in each frame.

    Images are scaled about a point `off_px` away from the principal points.
    """
    middle = np.tile([flight.P.cx_left_px + off_px, flight.P.cy_px], 2)
    return [replace(o, z_px=middle + k * (o.z_px - middle)) for o, k in zip(flight.observations(), longer, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize(("share", "off_px"), [(0.015, 0.0), (-0.003, 0.0), (0.03, 10.0)])
def test_while_a_focus_moves_and_after_it_has_stopped_poses_are_consistent(share: float, off_px: float) -> None:
    """The focus moves from 0.4 s to 1.4 s: the mean NEES at the end is consistent, and no pose on the way is beyond 5
    σ."""
    of_pose, worst = [], 0.0
    for seed in range(8):
        flight = Flight(seed, 0.0, 0.0, 44)
        seconds = np.arange(44) * flight.PERIOD_S
        true = flight.world_from_cam(seconds)
        solutions = run("cross-frame", flight.P, zoomed(flight, 1 + share * np.clip(seconds - 0.4, 0, 1), off_px))
        on_way = [nees_at(solution, pose) for solution, pose in zip(solutions[1:], true[1:], strict=True)]
        of_pose.append(on_way[-1])
        worst = max(worst, *on_way)
    assert np.sum(of_pose) < chi2.ppf(1 - 5e-4, 6 * len(of_pose))
    assert worst < 5**2 + 6


def test_a_jump_of_the_focal_length_is_found_in_its_frame_and_none_without_one() -> None:
    """None of 30 good frames is suspected; a jump by half a percent is, in its frame, and has ended before the last."""
    flight, at = Flight(1, 0.0, 0.0, 30), 9
    for jump in (0.0, 0.005):
        estimator = CrossFrame(flight.P, Config())
        moves = []
        for o in zoomed(flight, 1 + jump * (np.arange(30) >= at)):
            estimator.step(o)
            moves.append(estimator.map is not None and estimator.map.focus.moves)
        assert not any(moves[:at])
        assert moves[at] == (jump > 0)
    assert not moves[-1]


@pytest.mark.parametrize("changes", [False, True])
def test_a_focal_length_that_has_changed_is_held_there_and_not_as_calibrated(changes: bool) -> None:
    """An error found at 3 σ may be noise with an exact calibration, but not with a lens that has zoomed."""
    at, share, std_focal = TERMS.index(FOCAL), 0.01, RigConfig().std_focal
    rig = RigState.unknown(np.ones(len(TERMS)))
    if changes:
        rig = rig.refocused(share)[0]
    information, weighted = np.zeros((2, len(TERMS)))
    information[at], weighted[at] = 1.0, share / std_focal
    rig = rig.informed(information, weighted)
    cov = np.linalg.inv(rig.information)
    knowledge, _ = rig.judged(rig.mean + cov @ rig.weighted, cov, None)
    held = knowledge.held[at] * std_focal
    assert abs(held - share) < 1e-9 if changes else abs(held) < 0.1 * share


def test_errors_found_of_an_exact_rig_have_no_bias_even_in_the_shortest_window() -> None:
    """Over runs with different noise the mean estimate of an error of 0 is N(0, 1/n) in units of its σ, or less."""
    scene = replace(SCENE, track_length=8, std_px=0.3, frames=40, motion=MOTIONS["slow"])
    found = []
    for seed in np.random.SeedSequence(3).spawn(6):
        sequence = scene.sequence(seed)
        estimator = make_estimator("cross-frame", sequence.projection, Config(window=WindowConfig(frames=2)))
        for o in seen(sequence, np.zeros(M)):
            rig = estimator.step(o).rig
        assert isinstance(rig, RigEstimate)
        found.append((rig.mean_if_wrong / np.sqrt(np.diag(rig.cov_if_wrong)))[LENS])
    away = np.abs(np.mean(found, axis=0)) * np.sqrt(len(found))
    assert away.max() < norm.isf(5e-4 / M)  # 3.95; 8.1 if effects are evaluated at the positions of the smoothed window


def test_a_delay_known_beforehand_is_applied_and_kept() -> None:
    """Ten frames contain less information than the prior: the delay keeps its value, and σ does not grow."""
    flight, known = Flight(0, 0.008, 0.0, 10), KnownTiming(0.0081, 1e-4, 0.0, 1e-4)
    estimator = make_estimator("cross-frame", flight.P, Config())
    for o in flight.observations():
        assert o.rig is not None
        model = replace(o.rig.model, known_timing=known)
        solution = estimator.step(replace(o, rig=replace(o.rig, model=model)))
        if solution.rig is not None:
            mean, cov = model.timing(solution.rig)
            assert (np.abs(mean - (0.008, 0.0)) < 3e-4).all()
            assert (np.sqrt(np.diag(cov)) < 1.1e-4).all()
    assert solution.rig is not None


def test_a_field_that_is_noticed_late_is_the_same_as_one_from_the_start() -> None:
    """This holds while all frames are in the window; before, and in a rig without a field, it has no amplitudes."""
    sequence = SCENE.sequence(np.random.SeedSequence(0))
    observations = seen(sequence, np.zeros(M))[:8]
    estimators = [CrossFrame(sequence.projection, Config()) for _ in range(3)]
    for o in observations:
        assert o.rig is not None
        late, early, none = (
            estimator.step(replace(o, rig=replace(o.rig, field_std_px=std_px)))
            for estimator, std_px in zip(estimators, (0.1 if o.frame_index > 4 else 0.0, 0.1, 0.01), strict=True)
        )
    assert late.rig is not None and early.rig is not None and none.rig is not None
    assert len(none.rig.mean) == len(TERMS) < len(late.rig.mean) == len(early.rig.mean)
    std = np.sqrt(np.diag(early.rig.cov_if_wrong))
    assert (np.abs(late.rig.mean_if_wrong - early.rig.mean_if_wrong) < 0.05 * std).all()  # linearised elsewhere
    assert np.sqrt(np.diag(late.rig.cov_if_wrong)) == pytest.approx(std, rel=1e-2)
    # A pose continues from those reported before the field was noticed, which differ by the field.
    apart = np.abs(se3.log(se3.inverse(late.world_from_cam) @ early.world_from_cam))
    assert (apart < 0.3 * np.sqrt(np.diag(early.cov_pose))).all()


def test_rows_with_less_information_after_a_change_of_the_rig_subtract_none() -> None:
    """Their information about a delay is gone once all errors may have changed, so there is none to subtract."""
    sequence = Scene(frames=14, track_length=10, visible=40, std_px=STD_PX, round_off=False).sequence(
        np.random.SeedSequence(3)
    )
    observations = seen(sequence, np.zeros(M))
    informed, changed = 5, 9  # frames
    for k, o in enumerate(observations):
        assert o.rig is not None
        seconds = 1e-5 if informed <= k < changed else 1e-2
        root = np.eye(len(TERMS)) * 10 if k == changed else None
        rig = replace(o.rig, delay_by_rows=(seconds**-2.0, 0.0), change_root=root)
        observations[k] = replace(o, rig=rig)
    solutions = run("cross-frame", sequence.projection, observations)
    assert [s.status for s in solutions[1:]] == ["ok"] * (len(solutions) - 1)


def test_the_errors_of_a_refined_rig_are_gaussian_about_its_refinement() -> None:
    """They are never exactly zero, their sizes are learnt, and a delay that is known stays known."""
    flight, refinement = (
        Flight(0, 0.0, 0.0, 6),
        Refinement(np.zeros(len(LENS_TERMS)), 0.04 * np.eye(len(LENS_TERMS))),
    )
    estimator = make_estimator("cross-frame", flight.P, Config())
    known = KnownTiming(0.0, 1e-3, 0.0, 1e-3)
    for o in flight.observations():
        assert o.rig is not None
        model = RigModel.of(flight.P, RigConfig(), refinement, o.rig.model.row_of, known)
        found = estimator.step(replace(o, rig=replace(o.rig, model=model))).rig
    assert found is not None and found.p_wrong == 1 and (found.cov == found.cov.T).all()
    size = found.prior_std
    assert (size[: TERMS.index(FOCAL)] != 1.0).all() and (size[AT_TURNING] != 1.0).all()
    assert size[AT_TIMING] == pytest.approx(known.std / model.units_of_timing)
