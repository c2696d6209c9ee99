"""Tests of settings hashes and record ids: equal settings hash equally, unsafe ids are refused."""

import hashlib
import json

import pytest

from jbench.errors import RequestError
from jbench.settings.base import canonical_json, settings_hash


def test_hash_is_prefix_of_sha256_of_json_with_sorted_keys():
    settings = {"task": "x", "seed": 3, "noise": 0.1, "more": {"b": 1, "a": "é"}, "encoder": None}
    text = canonical_json(settings)
    assert json.loads(text) == settings
    assert text == ('{"encoder":null,"more":{"a":"\\u00e9","b":1},"noise":0.1,"seed":3,"task":"x"}')
    assert settings_hash(settings) == hashlib.sha256(text.encode()).hexdigest()[:8]


@pytest.mark.parametrize(
    "text",
    [
        "",
        ".",
        "..",
        "a/..",
        "../a",
        "a/../../b",
        "a/./b",
        "/a",
        "/etc/passwd",
        "a/",
        "a//b",
        "a\\b",
        "..\\a",
        ".hidden",
        "a/.hidden",
        "-rf",
        "_a",
        "a b",
        "a\n",
        "a\0",
        "é",
        "~",
    ],
)
def test_invalid_id_is_refused_with_example(text, results):
    with pytest.raises(RequestError, match="is not an id; an id looks like face_direction/"):
        results.find("run", text)
