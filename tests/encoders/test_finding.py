"""Tests of finding and loading encoders; damaged and untrusted files are refused."""

import json
import pathlib
import pickle
import shutil
import sys

import numpy as np
import pytest
import safetensors.numpy
import torch

from jbench.encoders import find_encoder, load_encoder
from jbench.encoders.registry import latent_sizes
from jbench.encoders.saved import DESCRIPTION, WEIGHTS
from jbench.errors import RequestError, WorkError
from jbench.representation_names import ENCODER_KINDS
from jbench.store import Results
from jbench.store.files import sha256
from tests.encoders.encoder_data import train
from tests.store.store_rows import alter_manifest

FACE = "face_direction"


class Bomb:
    """Creates a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return pathlib.Path.touch, (self.path,)


def add(results, id, updated, finished=True, **settings):
    """Adds an encoder without files, with the time of its last update."""
    settings = {"kind": "dae", "task": FACE, "latents": 12, **settings}
    record = results.create("encoder", id, settings)
    if finished:
        record.finish({})
    alter_manifest(record, updated=updated)


def replace_file(record, name, content):
    """Replaces a file and updates its checksum in the manifest."""
    (record.path / name).write_bytes(content)
    files = {entry.name: entry.model_dump() for entry in record.manifest.files}
    files[name] |= {"bytes": len(content), "sha256": sha256(content)}
    alter_manifest(record, files=list(files.values()))


def refusal(results, name, task=FACE):
    with pytest.raises(RequestError) as error:
        find_encoder(results, name, task)
    return str(error.value)


@pytest.fixture
def copied(tmp_path, trained):
    """A copy of the trained encoder, which tests may damage."""
    shutil.copytree(trained.results.path, tmp_path / "results")
    return Results(tmp_path / "results").find("encoder", trained.record.id)


@pytest.mark.parametrize(
    ("name", "task", "expected"),
    [
        ("12", FACE, "dae12/c"),
        ("dae:12", FACE, "dae12/c"),
        ("11", FACE, "dae11/e"),
        ("lld-vae:12", FACE, "lld-vae12/g"),
        ("pca12", FACE, "pca12/h"),
        ("12", "move_to_pose", "dae12/f"),
    ],
)
def test_newest_finished_encoder_of_plain_robot_is_selected(results, name, task, expected):
    results.create("dataset", "random/x", {"augment": 3})
    add(results, "face_direction/dae12/a", "2021", dataset="random/plain")
    add(results, "face_direction/dae12/b", "2022")
    add(results, "face_direction/dae12/c", "2023")
    add(results, "face_direction/dae12/augmented", "2030", dataset="random/x")
    add(results, "face_direction/dae12/d", "2024", finished=False)
    add(results, "face_direction/dae11/e", "2025", latents=11)
    add(results, "move_to_pose/dae12/f", "2026", task="move_to_pose")
    add(results, "face_direction/lld-vae12/g", "2020", kind="lld-vae")
    add(results, "face_direction/pca12/h", "2027", kind="pca")
    assert find_encoder(results, name, task) == f"{task}/{expected}"


def test_encoder_of_other_task_is_refused_with_command_to_type(trained):
    id = trained.record.id
    assert refusal(trained.results, id, "move_to_pose") == (
        f"The encoder {id} is for face_direction, not for move_to_pose; type "
        "jbench train-dae --task move_to_pose --latent 3 "
        f"--results {trained.results.path} to make one."
    )


def test_missing_size_is_refused_with_command_to_type(results):
    add(results, "face_direction/dae11/a", "2020", latents=11)
    for name, found, command in (
        ("12", "dae12", "train-dae --task face_direction --latent 12"),
        ("lld-vae:8", "lld-vae8", "train-encoder --kind lld-vae --task face_direction --latent 8"),
    ):
        assert refusal(results, name) == (
            f"No {found} for face_direction in {results.path}; type "
            f"jbench {command} --results {results.path} to make one."
        )


def test_unknown_id_is_refused_with_known_ids(results):
    command = f"jbench train-dae --task face_direction --results {results.path}"
    assert f"there is none yet: run {command}" in refusal(results, "face_direction/x")
    add(results, "face_direction/dae12/a", "2020")
    assert refusal(results, "face_direction/x").startswith(
        f"No encoder face_direction/x in {results.path}; there are face_direction/dae12/a. A kind"
    )


def test_encoders_of_other_tasks_are_not_proposed(results):
    add(results, "face_direction/dae12/a", "2020")
    add(results, "move_to_pose/dae3/b", "2021", task="move_to_pose", latents=3)
    assert "planar? there are face_direction/dae12/a. A kind" in refusal(results, "palnar")
    none_yet = "there is none yet: run jbench train-dae --task move_in_direction --results"
    assert none_yet in refusal(results, "palnar", "move_in_direction")


@pytest.mark.parametrize(("name", "meant"), [("plannar", "planar"), ("scald", "scaled")])
def test_misspelled_kind_is_refused_with_the_kind_that_was_meant(results, name, meant):
    assert f"No encoder {name} in {results.path}; did you mean {meant}? " in refusal(results, name)
    assert "did you mean" not in refusal(results, "other")


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (("dae:0", "dae17", "dae:", "dae:-1", "pca:1.5", "ae:x"), " has 1 to 16 latents; choose "),
        (("aee:3",), "Unknown kind of encoder 'aee'; did you mean ae?"),
        (("-3", "../x", "/etc/passwd", ""), "is not an id"),
        (("planar:11",), "planar of face_direction has 12 latents; choose planar."),
        (("planar", "planar:12"), "type jbench train-encoder --kind planar --task face_direction "),
    ],
)
def test_invalid_name_is_refused(results, names, sentence):
    for name in names:
        assert sentence in refusal(results, name)
    assert "did you mean face_direction?" in refusal(results, names[0], "face_directoin")


def test_unfinished_encoder_is_refused_with_its_command(results, monkeypatch):
    command = "jbench train-encoder --kind dae --set noise=0.2"
    monkeypatch.setattr(sys, "argv", ["/usr/bin/jbench", *command.split()[1:]])
    add(results, "face_direction/dae12/a", "2020", finished=False)
    for name in ("face_direction/dae12/a", "dae12"):
        assert refusal(results, name) == (
            f"The encoder face_direction/dae12/a is unfinished; repeat `{command}` to finish it."
        )
    # Only encoders that can be used are listed.
    assert "there is none yet" in refusal(results, "face_direction/x")


@pytest.mark.parametrize("name", [WEIGHTS, DESCRIPTION])
def test_altered_file_is_reported(copied, name):
    path = copied.path / name
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    with pytest.raises(WorkError, match=f"{copied.id}/{name} is damaged"):
        load_encoder(copied.path.parents[3], copied.id)


def with_arrays(change):
    return lambda content: safetensors.numpy.save(change(safetensors.numpy.load(content)))


def with_entries(**changed):
    """Content of a description with other entries, or without those that are None."""

    def changed_content(content):
        entries = json.loads(content) | changed
        return json.dumps({k: v for k, v in entries.items() if v is not None}).encode()

    return changed_content


FOREIGN = {
    "cut short": (WEIGHTS, lambda content: content[:-1]),
    "broken header": (WEIGHTS, lambda content: content[:8] + b"!" + content[9:]),
    "empty": (WEIGHTS, lambda content: b""),
    "huge": (WEIGHTS, lambda content: (2**63).to_bytes(8, "little") + content[8:]),
    "no tensors": (WEIGHTS, with_arrays(lambda arrays: {})),
    "other names": (WEIGHTS, with_arrays(lambda arrays: {"weight": np.zeros((3, 16))})),
    "other sizes": (WEIGHTS, with_arrays(lambda arrays: {n: a.T for n, a in arrays.items()})),
    "no numbers": (WEIGHTS, with_arrays(lambda arrays: {n: a * np.nan for n, a in arrays.items()})),
    "no JSON": (DESCRIPTION, lambda content: b"{"),
    "list": (DESCRIPTION, lambda content: b"[]"),
    "not UTF-8": (DESCRIPTION, lambda content: b"\xff{}"),
    "no scaling": (DESCRIPTION, with_entries(minimum=None)),
    "scaling of one": (DESCRIPTION, with_entries(minimum=[0.0], maximum=[1.0])),
    "scaling of words": (DESCRIPTION, with_entries(maximum=["one"] * 16)),
    "other latents": (DESCRIPTION, with_entries(latents=4)),
    "no latents": (DESCRIPTION, with_entries(latents=0)),
    "other features": (DESCRIPTION, with_entries(features=["x"] * 15)),
    "other kind": (DESCRIPTION, with_entries(kind="pca")),
    "unknown kind": (DESCRIPTION, with_entries(kind="os")),
    "no kind": (DESCRIPTION, with_entries(kind=None)),
    "other options": (DESCRIPTION, with_entries(options={"rate": 1})),
}


@pytest.mark.parametrize(("name", "change"), FOREIGN.values(), ids=FOREIGN)
def test_invalid_file_with_correct_checksum_is_refused(copied, name, change):
    replace_file(copied, name, change(copied.read_file(name)))
    with pytest.raises(WorkError, match=f"encoder {copied.id} can't be read .*; train it again"):
        load_encoder(copied.path.parents[3], copied.id)


@pytest.mark.parametrize("name", [WEIGHTS, DESCRIPTION])
def test_pickle_in_place_of_file_is_refused_and_not_run(tmp_path, copied, name):
    replace_file(copied, name, pickle.dumps(Bomb(tmp_path / "made")))
    with pytest.raises(WorkError, match=f"The encoder {copied.id} can't be read"):
        load_encoder(copied.path.parents[3], copied.id)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("kind", [kind for kind in ENCODER_KINDS if 4 in latent_sizes(kind, FACE)])
def test_encoder_of_each_kind_is_saved_and_loaded(trained, results, kind):
    record = train(trained.states, results, kind, 4)
    assert record.id.startswith(f"face_direction/{kind}4/s02-")
    assert find_encoder(results, f"{kind}:4", FACE) == record.id
    encoder = load_encoder(Results(results.path), record.id).encoder
    seen = np.random.default_rng(0).uniform(-1, 1, (2, 5, 16)).astype(np.float32)
    latents = encoder.encode(seen)
    assert (latents.shape, encoder.encode(seen[:0]).shape) == ((2, 5, 4), (0, 5, 4))
    np.testing.assert_allclose(encoder.encode(seen[1, 2]), latents[1, 2], atol=1e-6)
    for dtype in (torch.float32, torch.float64):
        in_torch = encoder.encode(torch.from_numpy(seen).to(dtype))
        assert in_torch.dtype == dtype
        np.testing.assert_allclose(in_torch.numpy(), latents, atol=1e-5)
