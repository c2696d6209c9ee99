"""Tests of `find_dataset`: the default, ids, error messages and damaged files."""

import json

import pytest

from jbench.datasets import find_dataset
from jbench.errors import RequestError
from jbench.store import Results


def add(results, id, updated="2020", finished=True, **settings):
    """Adds an empty dataset with the time of its last update."""
    record = results.create("dataset", id, settings)
    if finished:
        record.finish({}, join=False)
    path = record.path / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "updated": updated}))


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path)


def refusal(results, id=None):
    with pytest.raises(RequestError) as error:
        find_dataset(results, id)
    return str(error.value)


def test_newest_finished_dataset_is_default(results):
    add(results, "random/a", "2021")
    add(results, "random/b", "2023")
    add(results, "random/c", "2022")
    add(results, "random/d", "2024", finished=False)
    assert find_dataset(results).id == "random/b"
    assert find_dataset(results, "random/a").id == "random/a"


def test_augmented_dataset_is_selected_only_by_id(results):
    add(results, "random/augmented", "2024", augment=3)
    assert "name one with --dataset: random/augmented." in refusal(results)
    add(results, "random/plain", "2021", augment=None)
    assert find_dataset(results).id == "random/plain"
    assert find_dataset(results, "random/augmented").id == "random/augmented"


@pytest.mark.parametrize(
    ("there", "id", "says"),
    [
        ((), None, "run jbench collect --results {path} first (--steps 100000 makes a small one)"),
        ((), "random/a", "run jbench collect --results {path} first"),
        (("random/a",), "random/c", "No dataset random/c in {path}; there are random/a."),
        ((), "../a", "is not an id"),
    ],
)
def test_missing_dataset_is_refused_with_command_or_known_ids(results, there, id, says):
    for known in there:
        add(results, known)
    assert says.format(path=results.path) in refusal(results, id)


def test_unfinished_dataset_is_refused_with_command_to_resume(results):
    add(results, "random/a", finished=False)
    assert refusal(results).startswith("No finished dataset")
    assert refusal(results, "random/a") == (
        "The dataset random/a is unfinished; type the jbench collect command that started it "
        "to resume it."
    )


def test_only_dataset_with_damaged_manifest_is_reported(results):
    add(results, "random/a")
    path = results.path / "datasets" / "random" / "a" / "manifest.json"
    path.write_text("{")
    assert f"({path} is not a manifest" in refusal(results)
