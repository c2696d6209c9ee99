"""Tests of archives: what they have, that it verifies elsewhere, and that no name is left."""

import io
import re
import shutil
import socket
import zipfile
from types import SimpleNamespace

import pytest

from jbench.archive import blind, requirements, words, write
from jbench.archive.write import leaks, settings_of_datasets, write_archive
from jbench.errors import WorkError
from jbench.report import figures
from jbench.settings.base import in_id, settings_hash
from jbench.settings.records import EvaluationSettings
from jbench.store import Results
from jbench.store.verify import verify
from jbench.studies.matrix import read_matrix
from jbench.sweeps.cell import all_runs, matrix_cells
from tests.store.store_rows import RUN_SETTINGS, episodes

NAMES = {
    "host": "turing-cluster-7",
    "user": "ada.lovelace",
    "owner": "lovelace-lab",
    "module": "secret_agents",
    "class": "SecretAgent",
    "package": "hidden-package",
    "lab": "quiet_lab",
    "namespace": "riverside",
    "environment": "Kite-v0",
    "directory": "notebooks-of-ada",
}


KITE = f"gym:{NAMES['lab']}:{NAMES['namespace']}/{NAMES['environment']},wind=0.5"
SPECS = {
    "parts": ["place"],
    "sizes": [2],
    "action_minimum": [-1.0],
    "action_maximum": [1.0],
    "sources": "0123456789abcdef",
}


@pytest.fixture
def results(demo_results, tmp_path):
    """Those of the demo, and a run of an agent of another package, made by a known person."""
    place = tmp_path / NAMES["directory"] / "results"
    shutil.copytree(demo_results.path, place)
    results = Results(place)
    name = f"{NAMES['module']}:{NAMES['class']}"
    settings = {
        **RUN_SETTINGS,
        "algo": name,
        "engine": "plugin",
        "package": NAMES["package"],
        "evaluate_every": 1000,
        "evaluate_episodes": 1,
        "hyperparameters": {"notes": f"/home/{NAMES['user']}/notes", "rate": 0.1},
    }
    id = f"face_direction/{name.replace(':', '.')}/full/s00-{settings_hash(settings)}"
    made_on = {"package": f"{NAMES['package']} 1.0", "host": NAMES["host"]}
    run = results.create("run", id, settings, made_on)
    run.append({"episodes": episodes(id, [1.0, 2.0, 3.0])}, {"checkpoint.safetensors": b"state"})
    run.finish({"wall_time": 6.0, "note": NAMES["user"]}, keep=["checkpoint.safetensors"])
    of_kite = {**RUN_SETTINGS, "task": KITE, "specs": SPECS}
    kite_id = f"{in_id(KITE)}/ddpg/full/s00-{settings_hash(of_kite)}"
    kite = results.create("run", kite_id, of_kite, made_on)
    kite.append({"episodes": episodes(kite_id, [1.0, 2.0, 3.0])})
    kite.finish({"wall_time": 6.0})
    evaluated = EvaluationSettings(task="face_direction", policy=id, episodes=1)
    results.create("evaluation", evaluated.id, evaluated.model_dump()).finish({"median": 2.0})
    return results


@pytest.fixture
def known_machine(monkeypatch):
    """A machine and a user with names, and a git remote of an owner."""
    monkeypatch.setattr(socket, "gethostname", lambda: NAMES["host"])
    monkeypatch.setenv("USER", NAMES["user"])
    monkeypatch.setenv("HOME", f"/home/{NAMES['user']}")
    answers = {"config --get-regexp": f"remote.origin.url git@host.org:{NAMES['owner']}/thesis.git"}
    monkeypatch.setattr(words, "_git", lambda *typed: answers.get(" ".join(typed[:2]), ""))


def opened(path, tmp_path):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "elsewhere")
        entries = archive.infolist()
    return tmp_path / "elsewhere", entries


def content(results, kite=KITE):
    """Returns the returns of each run, by task, seed and number of rows; `kite` names one task."""
    return sorted(
        (
            kite if run.settings["task"] == KITE else run.settings["task"],
            run.settings["seed"],
            run.read("episodes")["episode_return"].to_pylist(),
        )
        for run in results.scan("run")[0]
    )


@pytest.mark.slow
@pytest.mark.parametrize("is_blind", [False, True])
def test_archive_verifies_and_reports_elsewhere(
    results, is_blind, tmp_path, known_machine, monkeypatch, run_command
):
    # Both have the default directory, and the default file.
    monkeypatch.chdir(results.path.parent)
    code, printed, _ = run_command("archive", *(["--blind"] if is_blind else []))
    assert (code, "without names" in printed) == (0, is_blind)
    file = "results-blind.zip" if is_blind else "results.zip"
    place, entries = opened(results.path.parent / file, tmp_path)
    # Another machine, where the first results are not.
    monkeypatch.undo()
    before = content(results, "task-1" if is_blind else KITE)
    shutil.rmtree(results.path)
    there = Results(place / "results")
    assert verify(there, 1).faults == []
    assert content(there) == before
    assert all(run.roles() == [] for run in there.scan("run")[0])
    code, *_ = run_command("report", "--format", "svg", results=place / "results")
    assert code == 0
    assert (place / "report" / "index.html").stat().st_size > 10_000
    readme = (place / "README.txt").read_text()
    assert "failed or left out: none" in readme
    assert ("git revision" in readme) == (not is_blind)
    assert re.search(r"^mujoco==3", (place / "requirements.txt").read_text(), re.M)
    assert {entry.date_time for entry in entries} == {(1980, 1, 1, 0, 0, 0)}


def test_no_name_is_left_in_a_blind_archive(results, tmp_path, known_machine, monkeypatch):
    (run,) = (run for run in results.scan("run")[0] if run.settings["engine"] == "plugin")
    unfinished = {**run.settings, "seed": 9}
    results.create("run", run.id[:-12] + f"s09-{settings_hash(unfinished)}", unfinished)
    with monkeypatch.context() as patch:
        patch.setattr(figures, "charts", lambda frames: [])  # the files of runs have the names, too
        write_archive(results, tmp_path / "named.zip")
    write_archive(results, tmp_path / "blind.zip", blind=True)
    names = set(NAMES.values())
    named = {name for _, name in leaks((tmp_path / "named.zip").read_bytes(), names)}
    assert named >= names - {NAMES["owner"], NAMES["directory"]}
    assert list(leaks((tmp_path / "blind.zip").read_bytes(), names)) == []
    place, _ = opened(tmp_path / "blind.zip", tmp_path)
    left_out = r"left out: run face_direction/agent-1/full/s09-[0-9a-f]{8}: unfinished\."
    assert re.search(left_out, (place / "README.txt").read_text())
    ids = {run.id[:-8] for run in Results(place / "results").scan("run")[0]}
    assert "task-1/ddpg/full/s00-" in ids


@pytest.mark.slow
def test_names_become_the_same_numbers_everywhere(results, tmp_path, known_machine):
    write_archive(results, tmp_path / "blind.zip", blind=True)
    place, _ = opened(tmp_path / "blind.zip", tmp_path)
    there = Results(place / "results")
    (run,) = (run for run in there.scan("run")[0] if run.settings["algo"] == "agent-1")
    assert run.id.startswith("face_direction/agent-1/full/s00-")
    assert run.settings["package"] == "package-1"
    assert run.settings["hyperparameters"] == {"notes": "left-out", "rate": 0.1}
    assert set(run.read("episodes")["run"].to_pylist()) == {run.id}
    assert run.manifest.provenance.keys() <= {*blind._KEPT, "packages"}
    (evaluation,) = there.scan("evaluation")[0]
    assert evaluation.settings["policy"] == run.id
    # Runs of jbench's own agents keep their ids.
    own = {run.id for run in results.scan("run")[0] if run.settings["algo"] == "td3"}
    assert own < {run.id for run in there.scan("run")[0]}


def test_any_number_of_kinds_of_encoders_have_letters(results):
    """Those of a module have two names, of which the second is in ids."""
    (encoder,) = results.scan("encoder")[0][:1]
    blinder = blind.Blinder(set())
    kinds = [
        f"lab:{chr(97 + first)}{chr(97 + second)}x" for first in range(5) for second in range(6)
    ]
    for kind in [*kinds, *kinds]:
        encoder.manifest.settings["kind"] = kind
        blinder.learn([encoder])
    blinded = [blinder.settings({"kind": kind})["kind"] for kind in kinds]
    assert blinded[:2] == ["kind-a", "kind-b"]
    assert blinded[25:28] == ["kind-z", "kind-aa", "kind-ab"]
    assert len({*blinded}) == len(kinds)


def test_names_within_longer_ones_and_paths_of_other_systems_are_told_apart():
    blinder = blind.Blinder({"ada"})
    for task in ("lab:hop", "mylab:hop", "lab:hop2"):
        blinder.learn([SimpleNamespace(kind="dataset", settings={"robot": task})])

    texts = {
        "lab:hop": "task-1",
        "mylab.hop/dae4/s00-12345678": "task-2/dae4/s00-12345678",
        "lab.hop2/dae4/s00-12345678": "task-3/dae4/s00-12345678",
        "dmc:hopper-hop": "dmc:hopper-hop",
        "Canada": "Canada",
        "C:\\Users\\other\\agent.py": "left-out",
        "\\\\server\\agent.py": "left-out",
        "file:///srv/agent.py": "left-out",
    }
    assert list(blinder.settings(dict(enumerate(texts))).values()) == list(texts.values())


def record(kind, id, **settings):
    return SimpleNamespace(kind=kind, id=id, settings=settings)


def blinded(*records):
    """Returns the ids of records in a blind archive, and the words that it must not have."""
    blinder = blind.Blinder(set())
    blinder.learn(records)
    return [blinder.id(record) for record in records], blinder.words


def test_task_of_a_namespace_has_a_number_in_ids():
    task = "gym:quiet_lab:riverside/Kite-v0"
    run = record("run", "gym.quiet_lab.riverside/Kite-v0/sac/full/s00-1", task=task, algo="sac")
    policy = in_id(run.id).replace("/", ".")
    evaluation = record("evaluation", f"{in_id(task)}/{policy}/s00-2", task=task, policy=run.id)
    (first, second), looked_for = blinded(run, evaluation)
    assert re.fullmatch(r"task-1/sac/full/s00-[0-9a-f]{8}", first)
    assert re.fullmatch(rf"task-1/{first.replace('/', '.')}/s00-[0-9a-f]{{8}}", second)
    assert looked_for >= {"quiet_lab", "riverside", "Kite-v0"}


def test_datasets_are_known_by_the_ids_that_encoders_have_in_the_archive(tmp_path):
    results = Results(tmp_path)
    id = f"{in_id(KITE)}/random/s00-1"
    settings = {"robot": KITE, "steps": 2000, "seed": 0}
    results.create("dataset", id, settings)
    encoder = record("encoder", f"{in_id(KITE)}/pca1/s00-2", task=KITE, dataset=id)
    assert settings_of_datasets(results, blind.Verbatim()) == {id: settings}
    blinder = blind.Blinder(set())
    blinder.learn([encoder])
    called = blinder.settings(encoder.settings)["dataset"]
    assert called == "task-1/random/s00-1"
    assert settings_of_datasets(results, blinder) == {called: settings}


def test_tasks_of_gymnasium_keep_their_names():
    names = {
        "gym:Pendulum-v1": "gym.Pendulum-v1/",
        "gym:Pendulum-v1,g=9.0": "gym.Pendulum-v1.g.9.0/",
        "dmc:cheetah-run": "dmc.cheetah-run/",
        "gym:Ant-v5,xml_file=quiet/b.xml": "task-1/",
        "gym:quiet:Kite-v1": "task-2/",
        "gym:quiet/Kite-v1": "task-3/",
    }
    runs = [record("run", f"{in_id(name)}/td3/full/s00-1", task=name, algo="td3") for name in names]
    ids, _ = blinded(*runs)
    assert [id.removesuffix(id[id.index("td3") :]) for id in ids] == list(names.values())


def test_user_and_host_that_are_words_of_every_archive_are_not_looked_for(
    known_machine, monkeypatch
):
    """Max and data are words of jbench's code, and etils is a package in requirements.txt."""
    monkeypatch.setenv("USER", "max")
    monkeypatch.setenv("LOGNAME", "Etils")
    monkeypatch.setenv("HOME", "/home/max")
    monkeypatch.setattr(socket, "gethostname", lambda: "data")
    found = words.words_of_this_machine()
    assert not {"max", "Etils", "data"} & found
    assert {"/home/max", NAMES["owner"]} <= found


def test_host_is_looked_for_with_its_domain_and_without(known_machine, monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: f"{NAMES['host']}.lab.org")
    assert {NAMES["host"], f"{NAMES['host']}.lab.org"} <= words.words_of_this_machine()


def test_requirements_are_what_an_index_has_with_the_extras_that_are_asked_for(monkeypatch):
    """The marker of an extra holds for those who ask for it, and spellings are one name."""
    needed = {
        "jbench": (
            "0.1.0",
            ["torch>=2", "Etils.Tools[epath]", "absent", 'extra_; extra == "onnx"'],
        ),
        "torch": ("2.13.0+cpu", ["etils_tools"]),
        "etils-tools": ("1.15.0", ['zipp; extra == "epath"', 'jax; extra == "enp"']),
        "zipp": ("4.1.2", []),
        "jax": ("1.0", []),
        "extra-": ("1.0", []),
    }

    def distribution(name):
        if name not in needed:
            raise requirements.importlib.metadata.PackageNotFoundError(name)
        version, requires = needed[name]
        return SimpleNamespace(version=version, requires=requires)

    monkeypatch.setattr(requirements.importlib.metadata, "distribution", distribution)
    _, *lines = requirements.requirements_text().splitlines()
    assert lines == ["etils-tools==1.15.0", "torch==2.13.0  # here 2.13.0+cpu", "zipp==4.1.2"]


def test_words_that_every_archive_has_are_not_looked_for():
    """A function may be called make, as in jbench's own code; its whole name is looked for."""
    run = record("run", "quiet.make/td3/full/s00-1", task="quiet:make", algo="td3")
    ids, looked_for = blinded(run)
    assert ids[0].startswith("task-1/td3/full/s00-")
    assert looked_for == {"quiet", "quiet:make", "quiet.make"}


@pytest.mark.parametrize("nested", [False, True])
def test_runs_of_different_code_are_different_runs(nested):
    runs = []
    for checksum in ("0123", "4567"):
        sources = {"sources": checksum}
        settings = {"specs": sources} if nested else sources
        id = f"face_direction/td3/full/s00-{checksum}"
        runs.append(record("run", id, task="face_direction", algo="td3", **settings))
    ids, looked_for = blinded(*runs)
    assert len({*ids}) == 2
    assert looked_for == {"0123", "4567"}


@pytest.mark.slow
def test_name_that_would_be_left_is_refused(results, tmp_path, known_machine, monkeypatch):
    """Such as a label that is the user's name: nothing is written."""
    monkeypatch.setattr(write, "words_of_this_machine", lambda *places: {"evaluation"})
    with pytest.raises(
        WorkError, match="The archive would have the word 'evaluation', which names"
    ):
        write_archive(results, tmp_path / "a.zip", blind=True)
    assert not (tmp_path / "a.zip").exists()


def test_leaks_are_found_in_columns_and_pictures(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    rows = pa.table({"x": ["ada"] * 100}, metadata={"owner": "charles"})
    pq.write_table(rows, tmp_path / "rows.parquet", compression="zstd")
    # The second accent is a character of its own.
    text = '{"by": "Jörg, JOSE\u0301 and \u0130D\u0131L; \u0130D\u0131Ls adamant"}'
    (tmp_path / "names.json").write_text(text, encoding="utf-8")
    info = PngInfo()
    info.add_text("Author", "byron", zip=True)
    Image.new("L", (2, 2)).save(tmp_path / "picture.png", pnginfo=info)
    with zipfile.ZipFile(sink := io.BytesIO(), "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(tmp_path.iterdir()):
            archive.write(path, path.name)
    words = {"ada", "charles", "byron", "picture", "jörg", "josé", "idil", "dils", "absent"}
    found = set(leaks(sink.getvalue(), words))
    assert found == {
        ("names.json", "jörg"),
        ("names.json", "josé"),
        ("names.json", "idil"),
        ("rows.parquet", "ada"),
        ("rows.parquet", "charles"),
        ("picture.png", "byron"),
        ("picture.png", "picture"),
    }


@pytest.mark.slow
def test_matrix_trains_the_runs_of_the_archive(demo_results, tmp_path):
    write_archive(demo_results, tmp_path / "a.zip")
    place, _ = opened(tmp_path / "a.zip", tmp_path)
    cells = matrix_cells(read_matrix(str(place / "matrix.toml")), demo_results)
    assert {run.id for run in all_runs(cells)} == {run.id for run in demo_results.scan("run")[0]}


@pytest.mark.slow
def test_unfinished_run_is_left_out_and_named(results, tmp_path):
    settings = {**RUN_SETTINGS, "seed": 5}
    id = f"face_direction/ddpg/full/s05-{settings_hash(settings)}"
    results.create("run", id, settings)
    written = write_archive(results, tmp_path / "a.zip")
    assert written.left_out == [f"run {id}: unfinished"]
    place, _ = opened(tmp_path / "a.zip", tmp_path)
    assert f"failed or left out: run {id}: unfinished." in (place / "README.txt").read_text()


def test_results_without_runs_are_refused(tmp_path, refused):
    (tmp_path / "empty").mkdir()
    assert "has no finished run" in refused("archive", tmp_path / "empty", "--out", tmp_path / "a")
    assert "not both" in refused("archive", "mine", "--results", "theirs")


def test_names_of_elements_of_a_drawing_name_nobody():
    drawing = b'<svg><cc:Work rdf:about="work">work of ada</cc:Work></svg>'
    boilerplate = b"<metadata><cc:Work><dc:type/></cc:Work></metadata>"
    with zipfile.ZipFile(sink := io.BytesIO(), "w") as archive:
        archive.writestr("a.svg", drawing)
        archive.writestr("b.svg", boilerplate)
    assert {*leaks(sink.getvalue(), {"work", "ada"})} == {("a.svg", "work"), ("a.svg", "ada")}
