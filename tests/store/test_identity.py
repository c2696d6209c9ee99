"""Tests of settings hashes and record ids: equal settings hash equally, unsafe ids are refused."""

import hashlib
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jbench.errors import RequestError
from jbench.settings.base import canonical_json, settings_hash

SETTINGS = {"task": "face_direction", "seed": 3, "noise": 0.1, "encoder": None, "more": {"b": 1}}
NUMBERS = st.integers() | st.floats(allow_nan=False, allow_infinity=False)


@given(st.dictionaries(st.text(), NUMBERS | st.dictionaries(st.text(), NUMBERS)), st.randoms())
@settings(max_examples=30)
def test_order_of_keys_does_not_matter(values, random):
    keys = list(values)
    random.shuffle(keys)
    shuffled = {key: values[key] for key in keys}
    assert canonical_json(shuffled) == canonical_json(values)
    assert json.loads(canonical_json(shuffled)) == values


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_nan_and_infinity_are_refused(value):
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical_json({"deep": [{"noise": value}]})


def test_hash_is_prefix_of_sha256_of_canonical_json():
    text = b'{"encoder":null,"more":{"b":1},"noise":0.1,"seed":3,"task":"face_direction"}'
    assert settings_hash(SETTINGS) == hashlib.sha256(text).hexdigest()[:8]


@pytest.mark.parametrize(
    "text",
    [
        *("", ".", "..", "a/..", "../a", "a/../../b", "a/./b", "/a", "/etc/passwd", "a/", "a//b"),
        *("a\\b", "..\\a", ".hidden", "a/.hidden", "-rf", "_a", "a b", "a\n", "a\0", "é", "~"),
    ],
)
def test_invalid_id_is_refused_with_example(text, results):
    with pytest.raises(RequestError, match="is not an id; an id looks like face_direction/"):
        results.find("run", text)
