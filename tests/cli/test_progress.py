"""The time left is predicted from the pace of the second half, whatever the beginning was like."""

import pytest

from stream_sfm.cli import progress


@pytest.fixture
def clock(monkeypatch):
    """Seconds that pass only where a test says so."""
    now = [1000.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_slow_beginning_is_no_pace(clock):
    remaining = progress.Remaining(100)
    for _ in range(2):
        assert remaining.text() == ""
        clock[0] += 20
        remaining.add(1)
    assert remaining.text() == ""
    remaining = progress.Remaining(100)
    for second in [60, *[1] * 49]:  # the first one loads and compiles
        clock[0] += second
        remaining.add(1)
    assert remaining.text() == "about 50 s left"  # and not 109 s


def test_a_pace_that_changes_is_followed_and_waiting_is_counted(clock):
    remaining = progress.Remaining(40)
    for second in [1] * 10 + [10] * 10:
        clock[0] += second
        remaining.add(1)
    assert remaining.text() == "about 3 min left"
    clock[0] += 150
    assert remaining.text() == "about 50 s left"


def test_large_things_take_longer_than_small_ones(clock):
    remaining = progress.Remaining(1000.0)
    for size in (10, 10, 480):
        clock[0] += size / 10
        remaining.add(size)
    assert remaining.text() == "about 50 s left"


def test_nothing_is_told_of_an_unknown_end_and_memory_is_bounded(clock):
    remaining = progress.Remaining(None)
    for _ in range(5000):
        clock[0] += 1
        remaining.add(1)
    assert remaining.text() == "" and len(remaining._history) <= progress._KEPT + 1


def test_long_times_are_in_minutes_and_hours():
    assert [progress._duration(s) for s in (4, 119, 600, 9000)] == ["4 s", "119 s", "10 min", "2 h 30 min"]
