"""Invalid settings are refused on construction, with what is wanted; all values within the bounds work."""

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import zip_longest
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config import FrontendConfig, WindowConfig, config_to_toml, read_config, setting_names
from stream_sfm.config.rules import Rules, kinds_of_rules
from stream_sfm.config.section import Section
from stream_sfm.frontend.learnt.pair_check import PairRules
from stream_sfm.frontend.learnt.usual_turns import TurnRules
from stream_sfm.frontend.rules import MotionRules
from stream_sfm.geometry import se3
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig
from tools.render.inertial import BMI160, measured

TINY = 1e-308  # squared, or as a divisor, it leaves the range of numbers


def kind_of(section: str) -> type[Section]:
    """The kind of a section such as `window` or `rules.turn`; of the whole for an empty name."""
    first, _, name = section.partition(".")
    return kinds_of_rules()[name] if name else type(getattr(sfm.Config(), first)) if first else sfm.Config


def numbers() -> dict[str, tuple[type, float, float]]:
    """Every setting that is a number: its type, and its least and largest value."""
    found = {}
    for name in setting_names():
        section, _, key = name.rpartition(".")
        hint = get_type_hints(kind_of(section), include_extras=True)[key]
        assert get_origin(hint) is Annotated, name
        number, meta = get_args(hint)
        if number in (int, float):
            found[name] = (number, meta.ge, meta.le)
    return found


NUMBERS = numbers()


def config_with(name: str, value: float) -> sfm.Config:
    """The defaults with one setting changed."""
    section, _, key = name.rpartition(".")
    made = kind_of(section)(**{key: value})
    if section.startswith("rules."):
        return sfm.Config(rules=Rules((made,)))
    return sfm.Config(**{section: made}) if section else made


def refused(name: str, value: float) -> bool:
    """Whether a value is refused with what is wanted instead."""
    try:
        config_with(name, value)
    except sfm.ConfigError as error:
        return "give" in str(error)
    return False


def test_numbers_have_two_ends_and_none_beyond_them_is_accepted() -> None:
    for name, (number, least, most) in NUMBERS.items():
        assert least is not None and most is not None and math.isfinite(least) and math.isfinite(most), name
        for end in (least, most):
            config_with(name, end)
        beyond = [math.nextafter(least, -math.inf), math.nextafter(most, math.inf)]
        if number is int:
            beyond = [least - 1, most + 1]
        beyond += [math.inf, -math.inf, math.nan, *([TINY] if least > 0 else [])]
        assert all(refused(name, value) for value in beyond), name
        with pytest.raises(sfm.ConfigError, match=f"{name} .* must be"):
            read_config(None, [f"{name}=inf"])


RIG = rig(width=160, height=120)
INERTIAL = replace(RIG, imu=BMI160.calibration)
FRAMES = 4


@pytest.fixture(scope="module")
def frames() -> list[sfm.StereoFrame]:
    """A short walk along a wall, which is covered and seen again, with the samples of an inertial unit."""
    wall, poses, period_s = Wall(), camera_path(FRAMES), 1e-9 * PERIOD_NS
    step = se3.log(poses[1])
    samples = measured(lambda t: se3.exp(step * t / period_s), (0, FRAMES * period_s), np.array([0.0, 1, 0]))
    ends = np.searchsorted(samples.stamps_ns, PERIOD_NS * np.arange(FRAMES), side="right") + 1
    seen = [
        replace(frame, imu=samples[first:end])
        for frame, first, end in zip(wall.frames(RIG, poses), [0, *ends], ends, strict=False)
    ]
    black = np.zeros((120, 160), np.uint8)
    seen[2] = replace(seen[2], left=black, right=black)
    return seen


OF_CONFIG = tuple(f"stream_sfm.config.{file}" for file in ("sections", "settings", "rules", "toml_text"))
OF_INERTIA, OF_ONE_CAMERA = ("imu.", "rules.inertia."), ("rules.mono.",)


def ends(of: tuple[str, ...], but: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Both ends of these settings, two different ones at a time."""
    found = [
        f"{name}={end!r}"
        for name, (number, least, most) in NUMBERS.items()
        if name.startswith(of) and not name.startswith(but)
        for end in (least, most, *([TINY] if number is float and least == 0 else []))
    ]
    half = (len(found) + 1) // 2
    return zip_longest(found[:half], found[half:], fillvalue='method="cross-frame"')


def follows(settings: tuple[str, ...], frames: list[sfm.StereoFrame]) -> bool:
    """Whether any frame is ok; all numbers are finite."""
    inertial, statuses = settings[0].startswith(OF_INERTIA), set()
    engine = sfm.Engine(INERTIAL if inertial else RIG, read_config(None, settings))
    for frame in frames:
        estimate = engine.step(frame if inertial else replace(frame, imu=None))
        statuses.add(estimate.status)
        for values in (estimate.world_from_cam, estimate.cov_pose, estimate.points_in_cam, estimate.cov_points):
            assert np.isfinite(values).all(), f"{settings}, frame {estimate.frame_index}"
        assert np.linalg.eigvalsh(estimate.cov_pose).min() >= -1e-9 * np.trace(estimate.cov_pose), settings
    return sfm.Status.OK in statuses


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        *ends(("",), ("ros.", "dense.", "rules.dense.", *OF_INERTIA, *OF_ONE_CAMERA)),
        *ends(OF_INERTIA, ("none",)),
        *((*pair, "mono=true") for pair in ends(OF_ONE_CAMERA, ("none",))),
    ],
    ids=" ".join,
)
def test_the_engine_works_at_both_ends_of_every_setting(
    settings: tuple[str, ...], frames: list[sfm.StereoFrame]
) -> None:
    """With one camera those that are for it alone, and with inertial samples those of inertia."""
    if not follows(settings, frames):  # one by which all frames are lost leaves the other one untried
        for setting in settings[:2]:
            follows((setting, *settings[2:]), frames)


@pytest.mark.parametrize(
    "make,message",
    [
        (lambda: sfm.Config(window=3), r"Config\(window=3\): give a WindowConfig, as in window=WindowConfig"),
        (lambda: sfm.Config(window={"frames": 3}), r"Config\(window={'frames': 3}\): give a WindowConfig"),
        (lambda: sfm.Config(window=FrontendConfig()), r"give a WindowConfig"),
        (lambda: sfm.Config(rules={"turn": 3}), r"give a Rules, as in rules=Rules"),
        (lambda: Rules((3,)), r"give sections of rules"),
        (lambda: sfm.Config(method=3), r"Config\(method=3\): give text"),
        (lambda: sfm.Config(mono="yes"), r"Config\(mono='yes'\): give true or false"),
        (lambda: WindowConfig(frames=0), r"WindowConfig\(frames=0\): give a whole number of at least 1"),
        (lambda: WindowConfig(frames=4.5), r"WindowConfig\(frames=4.5\): give a whole number"),
        (lambda: FrontendConfig(renew_fraction=float("nan")), r"renew_fraction=nan\): give a number of at least 0"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_refused_when_it_is_made(make: Any, message: str) -> None:
    with pytest.raises(sfm.ConfigError, match=message):
        make()


def test_settings_are_given_by_name_and_unknown_names_are_refused() -> None:
    with pytest.raises(TypeError, match="positional"):
        WindowConfig(8)
    with pytest.raises(TypeError, match="windw"):
        sfm.Config(windw=WindowConfig())


@pytest.mark.parametrize(
    "override, message",
    [
        ("window.frames=0", r"setting window\.frames is 0; it must be a whole number of at least 1"),
        ("window.frames=many", r"setting window\.frames is 'many'; it must be a whole number"),
        ("motion.std_acceleration_m_s2=0", r"it must be a number of at least 0\.001"),
        ("mono=1", r"setting mono is 1; it must be true or false"),
        ("window=3", r"setting window is 3; it must be a section"),
        ("expert=3", r"expert holds sections only, such as \[expert\.frontend\]"),
        ("expert.window=3", r"expert holds sections only"),
        ("expert.window.frame=8", r"unknown setting 'window\.frame'"),
        ("dense.voxel_m=1e-308", r"dense\.voxel_m is 1e-308; give at least 0\.0001, or 0"),
        ("window.frame=8", r"unknown setting 'window\.frame'; did you mean window\.frames\?"),
        ("widow.frames=8", r"unknown section 'widow'; did you mean window\?"),
        ("rules.turn.knocks=2", r"setting rules\.turn\.knocks is 2; it must be a number of at most 0\.5"),
        ("rules.turn.knock=0", r"unknown setting 'rules\.turn\.knock'; did you mean rules\.turn\.knocks\?"),
        ("rules.turns.knocks=0", r"unknown section 'rules\.turns'; did you mean rules\.turn\?"),
        ("rules.turn=3", r"setting rules\.turn is 3; it must be a section"),
        (
            "nonsense=1",
            r"unknown setting 'nonsense'; known are method, mask_left, mask_right, mono, frontend, window",
        ),
    ],
)
def test_a_file_is_refused_with_the_setting_and_what_it_must_be(override: str, message: str) -> None:
    with pytest.raises(sfm.ConfigError, match=message):
        read_config(None, [override])


def test_settings_made_in_python_equal_those_read_from_a_file(tmp_path) -> None:
    rules = Rules((MotionRules(full_history=5), PairRules(fit=0)))
    window, frontend = WindowConfig(frames=12), FrontendConfig(renew_fraction=1)
    made = sfm.Config(method="ekf", window=window, frontend=frontend, rules=rules)
    (tmp_path / "c.toml").write_text(config_to_toml(made))
    assert read_config(tmp_path / "c.toml") == made


def test_a_setting_may_be_in_its_section_or_in_that_of_experts_but_not_in_both() -> None:
    config = read_config(None, ["expert.window.max_iterations=3", "frontend.smoothing_px=2"])
    assert (config.window.max_iterations, config.frontend.smoothing_px) == (3, 2.0)
    with pytest.raises(sfm.ConfigError, match=r"window\.frames is set twice, also as expert\.window\.frames"):
        read_config(None, ["expert.window.frames=3", "window.frames=4"])


def test_settings_that_few_runs_need_are_printed_where_they_are_asked_for_or_changed() -> None:
    short, whole = (config_to_toml(sfm.Config(), expert=expert) for expert in (False, True))
    assert short.count(" = ") < 30 < whole.count(" = ") == len(setting_names())  # the dozen or two that matter
    assert "smoothing_px" not in short and "[expert.frontend]" in whole
    changed = sfm.Config(frontend=FrontendConfig(smoothing_px=2.0))
    assert "smoothing_px = 2.0" in config_to_toml(changed, expert=False)


def test_rules_are_those_of_the_rooms_unless_they_are_changed() -> None:
    """The list has the rules of every room, each once."""
    changed = read_config(None, ["rules.turn.knocks=1e-6", f"rules.pair.fit={PairRules().fit}"]).rules
    assert changed == Rules((TurnRules(knocks=1e-6),)) and changed.of(TurnRules).knocks == 1e-6
    assert changed.of(PairRules) == PairRules()
    kinds = list(kinds_of_rules().values())
    assert set(kinds) == {kind for kind in Section.__subclasses__() if kind.__module__ not in OF_CONFIG}
    assert len(set(kinds)) == len(kinds)


def test_few_settings_are_promises_and_each_is_described_by_itself() -> None:
    """All others are rules, which may change; no description needs that of a neighbour."""
    assert sum(not name.startswith("rules.") for name in setting_names()) <= 75
    told = [line[2:] for line in config_to_toml(sfm.Config()).splitlines() if line.startswith("# ")]
    leaning = re.compile(
        r"^the same|^to the left|that weight|after that$|of the two|this (average|check|judgement)|these"
    )
    assert not [text for text in told if leaning.search(text)]
