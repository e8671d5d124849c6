"""Laws of pairing: exact first, nearest within half a period, no stamp twice, order kept, all accounted for."""

import numpy as np
import pytest

from stream_sfm.recording.pairing import Pairer


def run(events):
    """Pairs of stamps and the counts, for (side, stamp) events in the order of the file."""
    pairer = Pairer()
    pairs = [p for side, stamp in events for p in pairer.push(side, stamp, stamp)]
    pairs += pairer.finish()
    return pairs, pairer.counts


def interleaved(left, right):
    return [(s, t) for t, s in sorted([(t, 0) for t in left] + [(t, 1) for t in right])]


def test_equal_stamps_pair_exactly():
    pairs, counts = run(interleaved(range(0, 1000, 100), range(0, 1000, 100)))
    assert pairs == [(t, t) for t in range(0, 1000, 100)]
    assert counts.paired == counts.paired_exactly == 10


def test_an_exact_partner_wins_over_an_earlier_near_one():
    pairs, _ = run(interleaved([0, 100, 160, 200, 300], [0, 100, 200, 300]))
    assert (200, 200) in pairs and (160, 200) not in pairs


@pytest.mark.parametrize(("offset", "paired"), [(30, 10), (-30, 10), (49, 10)])
def test_the_nearest_within_half_a_period(offset, paired):
    left = range(1000, 2000, 100)
    pairs, counts = run(interleaved(left, [t + offset for t in left]))
    assert pairs == [(t, t + offset) for t in left]
    assert counts.paired == paired and counts.largest_offset_ns == abs(offset)


def test_a_lone_frame_further_than_half_a_period_is_left_alone():
    pairs, counts = run(interleaved([0, 100, 200, 300], [0, 100, 255, 300]))
    assert (200, 255) not in pairs
    assert counts.unpaired == [1, 1]


def test_missing_frames_of_one_side_cost_only_themselves():
    right = [t for t in range(0, 40000, 100) if not 5000 <= t < 25000]
    pairs, counts = run(interleaved(range(0, 40000, 100), right))
    assert pairs == [(t, t) for t in right]
    assert counts.unpaired == [200, 0]


def test_modest_disorder_is_sorted_and_older_stamps_are_dropped():
    left = [0, 200, 100, 300, 400, 500, 600, 700, 800, 50, 900]
    pairs, counts = run([(0, t) for t in left] + [(1, t) for t in range(0, 1000, 100)])
    assert pairs == [(t, t) for t in range(0, 1000, 100)]
    assert counts.backwards == [1, 0]


def test_one_stamp_far_ahead_does_not_stop_the_rest():
    left = [0, 100, 10**9, 200, 300, 400, 500, 600]
    pairs, _ = run(
        interleaved([], []) + [e for t in left for e in ((0, t), (1, min(t, 150)))] + [(1, t) for t in left]
    )
    assert {(200, 200), (600, 600)} <= set(pairs)


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
            assert counts.paired + counts.unpaired[i] + counts.backwards[i] == len(sides[i]) == counts.read[i]
        assert all(abs(a - b) <= 60 for a, b in pairs)
        exact = set(sides[0]) & set(sides[1])
        assert {(t, t) for t in exact} <= set(pairs)


def test_waiting_is_bounded_when_one_side_is_silent():
    pairer = Pairer()
    for t in range(10_000):
        assert not list(pairer.push(0, t, t))
    assert len(pairer._queues[0]) <= 128
    assert not list(pairer.finish())
    assert pairer.counts.unpaired == [10_000, 0]


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
