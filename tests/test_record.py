"""Records and their changed copies."""

import copy
import pickle
from dataclasses import asdict, field, fields, is_dataclass, replace

import pytest

from stream_sfm.record import changed, record


@record
class Pair:
    one: int
    other: int = 0


def test_a_changed_record_is_another_one():
    pair = Pair(1)
    other = changed(pair, other=2)
    assert (pair.one, pair.other, other.one, other.other) == (1, 0, 1, 2) and type(other) is Pair


def test_a_field_that_is_not_there_cannot_be_changed():
    with pytest.raises(TypeError, match="`Pair` has no field 'others'"):
        changed(Pair(1), others=2)


def test_nothing_changes_a_record():
    with pytest.raises(AttributeError):
        Pair(1).one = 2


def test_the_default_of_a_field_is_made_for_each_record():
    @record
    class Listed:
        values: list[int] = field(default_factory=list)

    assert Listed().values is not Listed().values


def test_records_are_neither_compared_nor_printed():
    assert Pair(1) != Pair(1) and "other" not in repr(Pair(1)) and len({Pair(1), Pair(1)}) == 2


def test_a_record_can_be_pickled_and_copied():
    copies = [pickle.loads(pickle.dumps(Pair(1, 2))), copy.copy(Pair(1, 2)), copy.deepcopy(Pair(1, 2))]
    assert [(each.one, each.other) for each in copies] == [(1, 2)] * 3


def test_the_functions_of_dataclasses_take_records():
    assert [(f.name, f.type) for f in fields(Pair)] == [("one", int), ("other", int)] and is_dataclass(Pair)
    assert asdict(replace(Pair(1, 2), one=3)) == {"one": 3, "other": 2}
