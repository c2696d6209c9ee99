"""Tests of `jbench train-encoder`: all kinds, kinds of other packages, kills and errors."""

import hashlib
import json
import re
import shutil
import sys
from functools import partial

import pytest
import safetensors.numpy

from jbench.cli import main
from jbench.commands import encoders
from jbench.encoders.saved import DESCRIPTION, WEIGHTS
from jbench.encoders.training import CHECKPOINT
from jbench.store import Results
from jbench.store.tables import read_tables
from tests.command_line import SHORT, jbench, kill_when, start, succeed, train
from tests.commands.distributions import install
from tests.short_encoders import short_encoder_evaluation


@pytest.fixture(scope="module", autouse=True)
def _short_evaluation():
    with short_encoder_evaluation():
        yield


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """A results directory with a small dataset."""
    results = tmp_path_factory.mktemp("encoders") / "results"
    assert main(["collect", "--steps", "2000", "--results", str(results)]) == 0
    return results


@pytest.fixture(scope="module")
def filled(collected, tmp_path_factory):
    """The same directory with encoders of some kinds and sizes, trained in this process."""
    results = tmp_path_factory.mktemp("filled") / "results"
    shutil.copytree(collected, results)
    for arguments in (
        ("--kind", "dae,lld-vae", "--latent", "2-3", "--epochs", "2"),
        ("--kind", "pca,random,planar", "--latent", "2,16"),
        ("--kind", "scaled"),
    ):
        assert main(["train-encoder", *arguments, "--results", str(results)]) == 0
    return results


@pytest.fixture
def results(collected, tmp_path):
    """A copy of the directory with the dataset only, which tests may change."""
    shutil.copytree(collected, tmp_path / "results")
    return tmp_path / "results"


def test_each_kind_and_size_has_record_with_errors(filled):
    tables, problems = read_tables(Results(filled))
    assert problems == []
    rows = tables["encoders"].to_pandas().set_index("encoder")
    assert set(rows["status"]) == {"finished"}
    names = sorted(id.split("/")[1] for id in rows.index)
    assert names == [
        "dae2-epochs-2",
        "dae3-epochs-2",
        "lld-vae2-epochs-2",
        "lld-vae3-epochs-2",
        "pca16",
        "pca2",
        "planar12",
        "random16",
        "random2",
        "scaled16",
    ]
    errors = tables["encoder_errors"].to_pandas().set_index("encoder")
    assert rows["test_explained"].equals(errors.loc[rows.index, "test_explained"])
    for kind in ("pca", "random"):
        whole = rows[(rows["kind"] == kind) & (rows["latents"] == 16)]["test_explained"]
        assert whole.iloc[0] == pytest.approx(1, abs=1e-5)
    assert set(tables["encoder_features"].to_pandas()["encoder"]) == set(rows.index)


@pytest.mark.slow
def test_encoders_are_reported_and_used_in_training(filled, tmp_path):
    report = ("report", "--format", "png", "--out", str(tmp_path / "report"))
    assert main([*report, "--results", str(filled)]) == 0
    assert (tmp_path / "report" / "figures" / "encoders.png").stat().st_size > 0
    assert len((tmp_path / "report" / "tables" / "encoders.csv").read_text().splitlines()) == 1 + 10
    copy = tmp_path / "copy"
    shutil.copytree(filled, copy)
    short = ("--seeds", "0", "--steps", str(SHORT), "--evaluate-episodes", "0", "--jobs", "1")
    run = succeed(*train("td3", "lld-vae:3", *short), results=copy, short=True)
    assert "face_direction/td3/lld-vae3-epochs-2/s00-" in run.stdout
    run = succeed(*train("td3", "planar", *short), results=copy, short=True)
    assert "face_direction/td3/planar12/s00-" in run.stdout


def test_repeated_training_is_skipped_and_people_read_three_lines(filled, run_command, monkeypatch):
    before = {path: path.stat().st_mtime_ns for path in filled.rglob("*.parquet")}
    one = partial(run_command, "train-encoder", "--kind=pca", "--latent=2", results=filled)
    code, out, _ = one()
    assert code == 0
    what, explained, following = out.splitlines()
    assert what.startswith("The encoder face_direction/pca2/s00-")
    assert what.endswith(" is already finished; nothing to do.")
    row = read_tables(Results(filled)).tables["encoder_errors"].to_pandas().set_index("encoder")
    share = row.loc[what.split()[2], "test_explained"]
    assert f"it explains {share:.3f} of the variance (PCA with 2 latents: {share:.3f})" in explained
    assert re.search(r"R² yaw rate -?0\.\d{3}, tilt rate", explained)
    command = "Next: jbench train --task face_direction --encoder pca2"
    # The dataset is small: a trial, not ten seeds of five million control steps.
    assert following == f"{command} --steps 20k --seeds 0-1 --results {filled}"
    monkeypatch.setattr(encoders, "_TRIAL", 0)
    assert one()[1].endswith(f"\n{command} --results {filled}\n")
    printed = one("--verbose")[1]
    assert "Mean squared error of each scaled feature" in printed
    assert re.search(r"^ *motor_velocity +0\.\d{5}", printed, re.M)
    assert {path: path.stat().st_mtime_ns for path in filled.rglob("*.parquet")} == before


def test_next_command_names_the_id_of_an_encoder_that_is_not_the_newest(results, run_command):
    command = partial(run_command, "train-encoder", "--kind=pca", "--latent=2", results=results)
    for seed, encoder in ((0, "pca2"), (1, "pca2"), (0, r"face_direction/pca2/s00-[0-9a-f]{8}")):
        code, out, _ = command(f"--seed={seed}")
        assert code == 0
        assert re.search(f"Next: jbench train --task face_direction --encoder {encoder} ", out)


def test_warning_of_encoder_that_explains_far_less_than_pca(results, run_command):
    short = partial(run_command, "train-encoder", "--latent=12", "--epochs=1", results=results)
    code, _, err = short("--kind", "dae")
    assert code == 0
    assert "measuring what the latents explain and predict: 1 of 1 epochs" in err.splitlines()[0]
    (warned,) = (line for line in err.splitlines() if line.startswith("Warning"))
    assert re.search(
        r"dae12-epochs-1/s00-\S+ explains -?\d\.\d+ of the variance and PCA of", warned
    )
    assert "--epochs of more than 1," in warned
    # The loss of forward models is no reconstruction error.
    code, _, err = short("--kind", "forward")
    assert (code, "Warning" in err) == (0, False)


def test_mirror_of_mixed_latents_is_refused_before_training(filled, refused):
    mirror = ("--algo", "td3", "--set", "mirror=true")
    error = refused("train", "--encoder", "dae:2", *mirror, results=filled)
    assert "mirror=true needs inputs of which a mirror changes only signs" in error
    assert not (filled / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--kind", "dea"), "Unknown kind of encoder 'dea'; did you mean dae?"),
        (("--kind", "dae,pca", "--epochs", "3"), "pca has no option epochs"),
        (("--noise", "-0.1"), "noise of dae can't be -0.1"),
        (("--noise", "0.1", "--set", "noise=0.2"), "--set noise=0.2: type each setting once"),
        (("--latent", "2,many"), "--latent 2,many: type 12, or 2,4,8, or 1-16"),
        (("--device", "gpu"), "Unknown device 'gpu'; choose auto, cpu, cuda or cuda:1."),
        (("--seed", "-1"), "type seeds like 0-9"),
        (("--kind", "mine:Dae"), "mine:Dae: the name 'dae' is that of another kind"),
        (("--kind", "mine:Net2"), "mine:Net2: the name 'net2' must not end in a digit"),
        (("--kind", "mine:Texts"), "did you mean mine:Text?"),
    ],
)
def test_invalid_request_is_refused_and_trains_nothing(
    collected, arguments, message, tmp_path, monkeypatch, refused
):
    classes = "class Dae(Learned): pass\nclass Net2(Learned): pass\nclass Text: pass\n"
    (tmp_path / "mine.py").write_text(f"from jbench.encoders.kind import Learned\n{classes}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    assert message in refused("train-encoder", *arguments, results=collected)
    assert not (collected / "encoders").exists()


@pytest.fixture
def short(tmp_path):
    """A results directory with a small dataset of short episodes."""
    succeed("collect", "--steps", str(10 * SHORT), results=tmp_path / "short", short=True)
    return tmp_path / "short"


@pytest.mark.slow
def test_killed_training_resumes_bit_for_bit(short, tmp_path, refused):
    whole, results = tmp_path / "whole", short
    shutil.copytree(results, whole)
    arguments = ("train-encoder", "--latent", "5", "--epochs", "200", "--batch", "64")
    process = start(*arguments, results=results, short=True)
    manifests = (results / "encoders").rglob
    kill_when(
        lambda: any(CHECKPOINT in path.read_text() for path in manifests("manifest.json")), process
    )
    (row,) = read_tables(Results(results)).tables["encoders"].to_pylist()
    assert row["status"] == "unfinished"
    assert "is unfinished" in refused("train", "--encoder", row["encoder"], results=results)
    output = succeed(*arguments, results=results, short=True).stdout
    assert f"The encoder {row['encoder']} was interrupted; it resumes." in output
    succeed(*arguments, results=whole, short=True)
    kept = [Results(path).find("encoder", row["encoder"]) for path in (results, whole)]
    for name in (WEIGHTS, DESCRIPTION):
        assert kept[0].read_file(name) == kept[1].read_file(name)
    assert [record.rows("encoder_epochs") for record in kept] == [200, 200]
    for path in (results, whole):
        assert not list((path / "encoders").rglob("checkpoint*"))


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    page, module = "your-own-encoder.md", "third_party_encoder.py"
    part = "class FirstFeatures"
    return install("third_party_encoder", page, module, tmp_path_factory, part=part)


SHORT_TRAINING = ("--latent", "7", "--epochs", "2", "--set", "batch=500", "--json")


@pytest.mark.slow
def test_kind_of_other_package_is_trained(short, site, monkeypatch):
    run = partial(jbench, results=short, short=True)
    monkeypatch.setenv("PYTHONPATH", str(site))
    made = run("train-encoder", "--kind", "first-features,dae", *SHORT_TRAINING)
    assert made.returncode == 0, made.stderr
    theirs, ours = json.loads(made.stdout)["encoders"]
    assert theirs["settings"]["options"]["strength"] == 1.0
    # The package can't override a built-in kind.
    assert "noise" in ours["settings"]["options"]
    assert theirs["id"].startswith("face_direction/first-features7-batch-500-epochs-2/s00-")
    # Every weight is trained, so what keeps the first features must not be a weight.
    files = Results(short).find("encoder", theirs["id"])
    assert set(safetensors.numpy.load(files.read_file(WEIGHTS))) == {"predict"}
    refused = run("train-encoder", "--kind", "first-features", "--noise", "0.1")
    assert refused.returncode == 2
    assert "first-features has no option noise; it has batch, epochs," in refused.stderr
    # Without the package, only its encoder is refused.
    monkeypatch.delenv("PYTHONPATH")
    without = run("train", "--encoder", theirs["id"])
    assert without.returncode == 1
    assert "Unknown kind of encoder 'first-features'" in without.stderr
    assert run("query", "FROM encoders").returncode == 0


@pytest.mark.slow
def test_kind_of_a_module_is_trained_and_used(short, site, tmp_path, monkeypatch):
    run = partial(jbench, results=short, short=True)
    (source,) = site.rglob("third_party_encoder.py")
    (tmp_path / "mine.py").write_bytes(source.read_bytes())
    monkeypatch.chdir(tmp_path)
    kind = "mine:FirstFeatures"
    made = run("train-encoder", "--kind", kind, *SHORT_TRAINING)
    assert made.returncode == 0, made.stderr
    assert "--encoder first-features7-batch-500-epochs-2" in made.stderr
    (encoder,) = json.loads(made.stdout)["encoders"]
    assert encoder["id"].startswith("face_direction/first-features7-batch-500-epochs-2/s00-")
    assert encoder["settings"]["kind"] == kind
    record = Results(short).find("encoder", encoder["id"])
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    assert record.manifest.provenance["source_sha256"] == digest
    used = run(*train("td3", "first-features7", "--seeds", "0", "--steps", str(2 * SHORT)))
    assert used.returncode == 0, used.stderr
    typed = run("train", "--encoder", kind)
    named = f"{kind} is a kind of encoder, not an encoder; type --encoder first-features7-batch-500"
    assert named in typed.stderr
    monkeypatch.chdir(tmp_path.parent)
    without = run("train", "--encoder", encoder["id"])
    assert "mine:FirstFeatures can't be imported: there is no module mine" in without.stderr
    checked = run("verify", "--reevaluate", "--json")
    (again,) = json.loads(checked.stdout)["reevaluations"]
    assert (again["verdict"], "no module mine" in again["reason"]) == ("not comparable", True)
