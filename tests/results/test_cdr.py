"""Messages in CDR: the bytes are those that another implementation writes."""

from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stream_sfm.results.cdr import NUMBERS, Encoder

INNER, OUTER = "own_msgs/msg/Inner", "own_msgs/msg/Outer"
DEFINITIONS = {
    INNER: "uint8 a\nstring text\nbool b\n",
    OUTER: (
        "# what it is\nuint8 FIRST=1\nown_msgs/Inner part\nfloat64[] many\nint64[2] pair\nown_msgs/Inner[] parts\n"
        "string[] names\nuint8 last\n" + "".join(f"{kind} {kind}_{i}\n" for i in range(2) for kind in NUMBERS)
    ),
}


def message(rng: np.random.Generator, make: dict[str, type]) -> object:
    """A message of random lengths, so that parts begin at any byte; `make`: the types by name."""

    def text() -> str:
        return "σ" * int(rng.integers(9))

    def inner() -> object:
        return make[INNER](a=int(rng.integers(256)), text=text(), b=bool(rng.integers(2)))

    return make[OUTER](
        part=inner(),
        many=rng.normal(size=rng.integers(3)),
        pair=rng.integers(-9, 9, size=2),
        parts=[inner() for _ in range(rng.integers(3))],
        names=[text() for _ in range(rng.integers(3))],
        last=int(rng.integers(256)),
        **{f"{kind}_{i}": int(rng.integers(2)) for i in range(2) for kind in NUMBERS},
    )


def test_the_bytes_are_those_of_rosbags() -> None:
    store, encoder = get_typestore(Stores.EMPTY), Encoder(DEFINITIONS)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    for seed in range(200):
        theirs = message(np.random.default_rng(seed), store.types)
        ours = message(np.random.default_rng(seed), dict.fromkeys(DEFINITIONS, SimpleNamespace))
        assert encoder.encode(OUTER, ours) == bytes(store.serialize_cdr(theirs, OUTER, little_endian=True)), seed


def test_an_array_of_a_wrong_length_is_refused() -> None:
    wrong = message(np.random.default_rng(0), dict.fromkeys(DEFINITIONS, SimpleNamespace))
    wrong.pair = np.zeros(3, np.int64)
    with pytest.raises(ValueError, match="3 numbers is one of 2"):
        Encoder(DEFINITIONS).encode(OUTER, wrong)
