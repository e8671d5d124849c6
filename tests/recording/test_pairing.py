"""Laws of pairing: exact first, nearest within half a period, no stamp twice, order kept, every frame counted."""

import numpy as np
import pytest

from stream_sfm.logs.recording.pairing import Pairer


def run(events):
    """Pairs of stamps and the counts, for (side, stamp) events in the order of the file."""
    pairer = Pairer()
    pairs = [p for side, stamp in events for p in pairer.push(side, stamp, stamp)]
    pairs += pairer.finish()
    return pairs, pairer.counts


def interleaved(left, right):
    return [(s, t) for t, s in sorted([(t, 0) for t in left] + [(t, 1) for t in right])]


@pytest.mark.parametrize("offset", [30, -30, 49])
def test_the_nearest_within_half_a_period(offset):
    left = range(1000, 2000, 100)
    pairs, counts = run(interleaved(left, [t + offset for t in left]))
    assert pairs == [(t, t + offset) for t in left]
    assert counts.paired == 10 and counts.largest_offset_ns == abs(offset)


def test_a_lone_frame_further_than_half_a_period_is_left_alone():
    pairs, counts = run(interleaved([0, 100, 200, 300], [0, 100, 255, 300]))
    assert (200, 255) not in pairs
    assert counts.unpaired == [1, 1]


def test_modest_disorder_is_sorted_and_older_stamps_are_dropped():
    left = [0, 200, 100, *range(300, 4000, 100), 50, *range(4000, 5000, 100)]
    pairs, counts = run([(0, t) for t in left] + [(1, t) for t in range(0, 5000, 100)])
    assert pairs == [(t, t) for t in range(0, 5000, 100)]
    assert counts.disordered == [1, 0]


PERIOD = 33_000_000
HOUR = 3600 * 10**9


def run_both(stamps):
    """Both cameras with the same stamps, in the order of arrival."""
    return run([(side, stamp) for stamp in stamps for side in (0, 1)])


@pytest.mark.parametrize("away", [HOUR, -HOUR, 40 * PERIOD])
@pytest.mark.parametrize("places", [[0], [1, 2, 3], [10, 20, 21, 22, 40, 60], [40, 41, 42, 43, 44, 45], [78, 82]])
def test_stray_stamps_are_dropped_and_cost_nothing_else(places, away):
    if away > 0 and places == [0]:
        pytest.skip("by its stamps alone, a recording that begins late and is then set back is no different")
    stamps = [HOUR * 24 + n * PERIOD for n in range(84)]
    strays = [stamps[n] + away for n in places]
    pairs, counts = run_both([t if n not in places else t + away for n, t in enumerate(stamps)])
    found = [left for left, _ in pairs]
    assert set(stamps) - {stamps[n] for n in places} <= set(found)
    if abs(away) == HOUR:
        assert not set(strays) & set(found) and counts.disordered == [len(places)] * 2


def test_a_clock_set_back_or_forth_costs_no_frame():
    first, second = [HOUR * 24 + n * PERIOD for n in range(30)], [HOUR * 23 + n * PERIOD for n in range(54)]
    for stamps in (first + second, second + first, first + second + first[:20]):
        pairs, counts = run_both(stamps)
        assert [left for left, _ in pairs] == [right for _, right in pairs] == stamps
        assert counts.disordered == [0, 0]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 40])
def test_frames_that_are_minutes_apart_are_all_used(count):
    stamps = [n * 200 * 10**9 for n in range(count)]
    assert [left for left, _ in run_both(stamps)[0]] == stamps


def test_a_clock_of_one_camera_set_back_leaves_its_frames_unpaired():
    stamps = [HOUR + n * PERIOD for n in range(60)]
    pairs, counts = run([(side, t - HOUR * (side and n >= 30)) for n, t in enumerate(stamps) for side in (0, 1)])
    assert [left for left, _ in pairs] == stamps[:30] and counts.unpaired == [30, 30] and counts.parted == 30


@pytest.mark.parametrize("away", [HOUR, -HOUR])
@pytest.mark.parametrize("side", [0, 1])
def test_clocks_that_differ_for_a_while_are_distinguished_from_lost_frames(side, away):
    stamps = [HOUR * 24 + n * PERIOD for n in range(84)]
    for end in (60, 84):
        moved = {t for t in stamps[30:end]}
        _, counts = run([(s, t + away * (s == side and t in moved)) for t in stamps for s in (0, 1)])
        assert counts.parted >= end - 30 - 12
    lost = {0: {*stamps[20:31]}, 1: {*stamps[31:42]}}  # first the one camera, then the other
    _, counts = run([(s, t) for t in stamps for s in (0, 1) if t not in lost[s]])
    assert counts.unpaired == [11, 11] and not counts.parted


def test_a_stamp_that_comes_twice_is_used_once():
    stamps = [n * PERIOD for n in range(40)]
    late = [t for pair in zip(stamps, [None] * 5 + stamps, strict=False) for t in pair if t is not None]
    pairs, counts = run_both(late)  # a second publisher, five frames late
    assert [left for left, _ in pairs] == stamps and counts.disordered == [35, 35]


def test_random_logs_keep_the_laws():
    rng = np.random.default_rng(5)
    for _ in range(60):
        times = np.arange(80) * 100
        sides = [
            [int(t + rng.integers(-20, 21) * (rng.random() < 0.5)) for t in times if rng.random() > 0.15]
            for _ in range(2)
        ]
        events = interleaved(*sides)
        pairs, counts = run(events)
        for i in (0, 1):
            stamps = [p[i] for p in pairs]
            assert stamps == sorted(set(stamps))
            assert set(stamps) <= set(sides[i])
            assert counts.paired + counts.unpaired[i] + counts.disordered[i] == len(sides[i]) == counts.read[i]
        assert all(abs(a - b) <= 60 for a, b in pairs)  # half a period, and the jitter
        exact = set(sides[0]) & set(sides[1])
        assert {(t, t) for t in exact} <= set(pairs)


def test_waiting_is_bounded_when_one_side_is_silent():
    """128 frames in order, and a window of those being put in order: what was counted and not dropped is held."""
    pairer = Pairer()
    for t in range(1000):
        assert not list(pairer.push(0, t, t))
        assert pairer.counts.read[0] - pairer.counts.unpaired[0] <= 128 + 13
    assert not list(pairer.finish())
    assert pairer.counts.unpaired == [1000, 0]


def test_large_frames_of_one_side_do_not_pile_up():
    """Of 60 MiB each: three wait for the silent side, and those of both sides still meet."""
    pairer = Pairer()
    held = max_held = 0

    class Frame:
        def __init__(self) -> None:
            nonlocal held, max_held
            held += 1
            max_held = max(max_held, held)

        def __del__(self) -> None:
            nonlocal held
            held -= 1

    pairs = 0
    for n in range(40):
        for side in (0, 1) if n < 5 or n > 30 else (0,):
            pairs += sum(1 for _ in pairer.push(side, 100 * n, Frame(), 60 * 2**20))
    pairs += sum(1 for _ in pairer.finish())
    assert pairs == 14 and pairer.counts.unpaired == [26, 0]
    assert max_held <= 8
