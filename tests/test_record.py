"""Records and their changed copies."""

import pytest

from stream_sfm.record import changed, record


@record
class Pair:
    one: int
    other: int = 0


def test_a_changed_record_is_another_one():
    pair = Pair(1)
    copy = changed(pair, other=2)
    assert (pair.one, pair.other, copy.one, copy.other) == (1, 0, 1, 2) and type(copy) is Pair


def test_a_field_that_is_not_there_cannot_be_changed():
    with pytest.raises(TypeError, match="Pair has no field others"):
        changed(Pair(1), others=2)
