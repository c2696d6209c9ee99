"""Tests of the sources of a report: runs since a date, two compared sides, shipped runs."""

import os
import shutil
import sys

import numpy as np
import pytest

from jbench.errors import RequestError
from jbench.report.data import sources
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.settings.base import validated
from jbench.store import Record, Results
from jbench.store.shipped import shipped_results
from tests.store.store_rows import alter_manifest

FLAT = np.full(40, 500.0)


class TestSince:
    @pytest.fixture
    def dated(self, fabric):
        for seed, when in enumerate(("2026-11-19T23:59:59+00:00", "2026-11-20T00:00:00+00:00")):
            alter_manifest(fabric.run(FLAT, seed), created=when)
        return fabric.results

    @pytest.mark.parametrize(
        ("since", "seeds"),
        [("2026-11-19", [0, 1]), ("2026-11-20", [1]), ("2026-11-20T01:00:00+01:00", [1])],
    )
    def test_earlier_runs_are_skipped_and_noted(self, dated, since, seeds):
        found = Frames(dated, Request(since=since))
        assert found.seeds["seed"].tolist() == seeds
        assert any("begun before" in note for note in found.notes) == (len(seeds) == 1)

    def test_no_run_since_date_is_refused(self, dated):
        with pytest.raises(RequestError, match=r"No run was begun since 2026-12-01\. 2 runs"):
            Frames(dated, Request(since="2026-12-01"))


class TestCompare:
    @pytest.fixture
    def both(self, fabric):
        fabric.flat([500, 501, 502], engine="sb3", hyperparameters={"tau": 0.5})
        fabric.flat([600, 601, 602], engine="batched", hyperparameters={"tau": 0.5})
        fabric.flat([500] * 3, engine="sb3", hyperparameters={"tau": 0.25})
        return fabric.results

    def test_two_values_of_setting_are_compared(self, both):
        found = Frames(both, Request(compare=("engine=batched", "engine=sb3")))
        (one,) = found.comparisons.to_dict("records")
        assert (one["a"], one["b"]) == ("engine=batched", "engine=sb3")
        assert (one["difference"], one["p"]) == (100, 1)
        assert one["text"] == "undecided: +100, too few seeds"
        assert found.headline.startswith("Too early to say")
        # Runs with another tau have no counterpart; they are shown and noted.
        assert len(found.configurations) == 3
        assert any(note.startswith("Only in engine=sb3:") for note in found.notes)

    def test_headline_speaks_of_the_comparison(self, fabric):
        for engine, level in (("sb3", 500), ("batched", 600)):
            fabric.flat(range(level, level + 6), engine=engine)
            fabric.flat(range(500, 506), engine=engine, algo="sac")
        found = Frames(fabric.results, Request(compare=("engine=batched", "engine=sb3")))
        assert found.headline == (
            "The final return with engine=batched, compared with engine=sb3, is higher in 1 and "
            "similar in 1 of 2 configurations."
        )

    def test_rule_of_a_user_is_compared_with_its_parent(self, fabric):
        fabric.run(FLAT, engine="batched")
        fabric.run(FLAT + 10, engine="batched", algo="mine:Huber", sources="3f2a91aa")
        compare = ("algo=mine:Huber", "algo=td3")
        (one,) = Frames(fabric.results, Request(compare=compare)).comparisons.to_dict("records")
        assert (one["a"], one["difference"]) == ("algo=mine:Huber", 10)

    def test_versions_of_code_are_compared_by_what_names_call_them(self, fabric):
        for level, code in ((600.0, "3f2a91" + "0" * 58), (500.0, "77c0d2" + "0" * 58)):
            fabric.flat([level], engine="batched", algo="mine:Huber", sources=code)
        names = Frames(fabric.results, Request()).configurations["words"]
        assert all(any(code in name for name in names) for code in ("code 3f2a91", "code 77c0d2"))
        for sides in (
            ("code=3f2a91", "code=77c0d2"),
            ("code 3f2a91 of 2026-11-28", "code 77c0d2"),  # as names call it
            ("algo=mine:Huber, code=3f2a91 of 2026-11-28", "algo=mine:Huber,code=77c0"),
        ):
            (one,) = Frames(fabric.results, Request(compare=sides)).comparisons.to_dict("records")
            names = [side.split(",")[-1].strip() for side in sides]
            assert [one["a"], one["b"], one["difference"]] == [*names, 100]

    def test_versions_of_code_of_one_day_are_named_and_compared_by_their_times(self, fabric):
        versions = (
            (500.0, "3f2a91", "2026-11-28T09:05:59+00:00"),
            (600.0, "77c0d2", "2026-11-28T17:30:00+00:00"),
            (700.0, "b10c4e", "2026-11-29T17:30:00+00:00"),
        )
        for level, code, created in versions:
            run = {"engine": "batched", "algo": "mine:Huber", "sources": code + "0" * 58}
            alter_manifest(fabric.run(np.full(40, level), **run), created=created)

        names = sorted({*Frames(fabric.results, Request()).configurations["words"]})
        assert names == [
            "code 3f2a91 of 2026-11-28 09:05",
            "code 77c0d2 of 2026-11-28 17:30",
            "code b10c4e of 2026-11-29",
        ]
        sides = names[1], names[0]
        (one,) = Frames(fabric.results, Request(compare=sides)).comparisons.to_dict("records")
        assert (one["a"], one["b"], one["difference"]) == (*sides, 100)

    def test_versions_of_code_without_a_checksum_are_compared_by_their_dates(self, fabric):
        """Older versions recorded the code in the provenance only."""
        versions = (
            (300.0, "2026-11-27", "a", {}),
            (400.0, "2026-11-28", "b", {}),
            (600.0, "2026-11-28", "c", {}),
            (650.0, "2026-11-28", "f", {}),
            (700.0, "2026-11-28", "d", {"sources": "3f2a91" + "0" * 58}),
        )
        for level, date, digit, more in versions:
            run = {"engine": "batched", "algo": "mine:Huber", **more}
            record = fabric.run(np.full(40, level), **run)
            provenance = {**record.manifest.provenance, "source_sha256": 64 * digit}
            # Two of these versions were first used in the same minute.
            hour = {"f": 17}.get(digit, 10)
            created = f"{date}T{hour}:00:00.{int(digit, 16)}+00:00"
            alter_manifest(record, created=created, provenance=provenance)

        assert sorted(Frames(fabric.results, Request()).configurations["words"]) == [
            "code 3f2a91 of 2026-11-28",
            "code of 2026-11-27",
            "code of 2026-11-28 10:00 (1)",
            "code of 2026-11-28 10:00 (2)",
            "code of 2026-11-28 17:00",
        ]
        for sides, difference in (
            (("code of 2026-11-28 10:00 (2)", "code of 2026-11-27"), 300),
            (("code of 2026-11-28 17:00", "code of 2026-11-28 10:00 (2)"), 50),
            (("code=3f2a91", "algo=mine:Huber, code=2026-11-28 10:00 (1)"), 300),
            (("code of 2026-11-27", "code 3f2a91 of 2026-11-28"), -400),
        ):
            (one,) = Frames(fabric.results, Request(compare=sides)).comparisons.to_dict("records")
            assert (one["a"], one["b"], one["difference"]) == (*sides, difference)

    def test_unknown_version_of_code_is_refused_with_those_that_there_are(self, fabric):
        fabric.run(FLAT, engine="batched", algo="mine:Huber", sources="3f2a91" + "0" * 58)
        fabric.run(FLAT)
        printed = r"No run has code=abc; there are 3f2a91\."
        with pytest.raises(RequestError, match=printed):
            Frames(fabric.results, Request(compare=("code=abc", "code=3f2a91")))

    def test_code_without_a_checksum_is_named_beside_code_with_one(self, fabric):
        for level, more in ((500.0, {}), (600.0, {"sources": "3f2a91" + "0" * 58})):
            run = {"engine": "batched", "algo": "mine:Huber", **more}
            record = fabric.run(np.full(40, level), **run)
            digest = str(int(level))
            provenance = {**record.manifest.provenance, "source_sha256": digest}
            created = f"2026-11-2{digest[0]}T10:00:00+00:00"
            alter_manifest(record, created=created, provenance=provenance)

        names = sorted(Frames(fabric.results, Request()).configurations["words"])
        assert names == ["code 3f2a91 of 2026-11-26", "code of 2026-11-25"]
        compare = (names[1], names[0])
        (one,) = Frames(fabric.results, Request(compare=compare)).comparisons.to_dict("records")
        assert one["difference"] == -100
        printed = r"No run has code of 2026-11-26; there are code of 2026-11-25\."
        with pytest.raises(RequestError, match=printed):
            Frames(fabric.results, Request(compare=("code of 2026-11-26", names[1])))

    def test_omitted_setting_is_compared_by_its_default(self, fabric):
        fabric.run(FLAT)
        fabric.run(FLAT + 10, precision="bfloat16")
        compare = ("precision=bfloat16", "precision=float32")
        (one,) = Frames(fabric.results, Request(compare=compare)).comparisons.to_dict("records")
        assert (one["a"], one["difference"]) == ("precision=bfloat16", 10)

    @pytest.mark.parametrize("typed", ["tau=0.25", "tau=2.5e-1", "hyperparameters.tau=0.25"])
    def test_hyperparameter_is_found_by_short_or_full_name(self, both, typed):
        other = f"{typed.split('=')[0]}=0.5, engine=sb3"
        (one,) = Frames(both, Request(compare=(typed, other))).comparisons.to_dict("records")
        assert (one["a"], one["b"], one["difference"]) == (typed, other, -1)

    def test_whole_numbers_are_compared_by_all_their_digits(self, fabric):
        for size in (1_000_000, 1_000_001):
            fabric.run(FLAT + size % 10, hyperparameters={"buffer_size": size, "tau": 0.5})
        compare = ("buffer_size=1e6", "buffer_size=1000001")
        (one,) = Frames(fabric.results, Request(compare=compare)).comparisons.to_dict("records")
        assert (one["seeds_a"], one["seeds_b"], one["difference"]) == (1, 1, -1)

    def test_list_is_a_setting_although_it_has_commas(self, fabric):
        for layers in ([8, 8], []):
            fabric.run(FLAT + len(layers), hyperparameters={"hidden_layers": layers})
        compare = ("hidden_layers=[8,8], algo=td3", "algo=td3,hidden_layers=[]")
        (one,) = Frames(fabric.results, Request(compare=compare)).comparisons.to_dict("records")
        assert (one["a"], one["b"]) == ("hidden_layers=[8,8]", "hidden_layers=[]")
        assert one["difference"] == 2

    @pytest.mark.parametrize(
        ("recorded", "shown"),
        [
            ("dae12", "dae12"),
            ("planar12", "planar"),
            pytest.param("planar12", "planar12", marks=pytest.mark.slow),
        ],
    )
    def test_settings_are_found_by_what_tables_and_options_call_them(self, recorded, shown, fabric):
        fabric.run(FLAT)
        fabric.run(FLAT + 10, representation=recorded)
        for sides in (
            (f"algorithm=td3, observation={shown}", "observation=full"),
            (f"representation={shown}", "representation=none"),
            (f"observation={shown}", "observation=none"),
            (f"encoder={shown}", "encoder=none"),  # as `jbench train --encoder` takes them
        ):
            (one,) = Frames(fabric.results, Request(compare=sides)).comparisons.to_dict("records")
            assert (one["a"], one["b"], one["difference"]) == (*sides, 10)

    @pytest.mark.parametrize(
        ("compare", "printed"),
        [
            (("engine=none", "engine=sb3"), "No run has engine=none; there are batched, sb3"),
            (("zzz=1", "engine=sb3"), "No run has a setting 'zzz'; there are .*algo, .*tau"),
            # The table of a setting is named only where two have the same name.
            (("taau=1", "tau=0.5"), r"'taau'; did you mean tau\? There are [^.]*\.$"),
            (("nowhere", "engine=sb3"), "there is no such directory; type two results dir"),
            (("sb3", "batched"), "or settings such as engine=sb3."),
            (("tau=0.25, engine=batched", "tau=0.5"), "no run with an episode of tau=0.25"),
            (("tau=0.25", "tau=2.5e-1"), "tau=0.25 and tau=2.5e-1 have the same settings."),
            (("a", "a"), "type two results directories"),
        ],
    )
    def test_invalid_comparison_is_refused(self, both, compare, printed):
        with pytest.raises(RequestError, match=printed):
            Frames(both, validated(Request, "the report", compare=compare))

    def test_settings_of_no_runs_are_refused(self, fabric):
        sides = ("tau=0.5", "tau=0.25")
        with pytest.raises(
            RequestError, match=r"^No run has a setting 'tau': there are no runs\.$"
        ):
            Frames(fabric.results, Request(compare=sides))

    @pytest.mark.skipif(sys.platform != "linux", reason="elsewhere all names are Unicode")
    def test_directory_whose_name_is_not_unicode_is_compared(self, fabric, tmp_path):
        fabric.run(FLAT, 0)
        other = shutil.copytree(fabric.results.path, tmp_path / os.fsdecode(b"a\xff"))
        compare = str(other), str(fabric.results.path)
        found = Frames(fabric.results, Request(compare=compare))
        assert set(found.configurations["source"]) == {"a\\udcff", "results"}

    def test_two_directories_are_compared(self, fabric, tmp_path):
        other = type(fabric)(tmp_path / "other")
        fabric.flat([500] * 3)
        other.flat([300] * 3, steps=99_000)
        other.run(FLAT, 0, algo="sac")
        sides = str(tmp_path / "results"), str(tmp_path / "other")
        found = Frames(fabric.results, Request(compare=sides))
        (one,) = found.comparisons.to_dict("records")
        assert one["difference"] == 200
        assert set(found.configurations["source"]) == {"results", "other"}
        assert any("Only in" in note and "SAC" in note for note in found.notes)

    def test_directory_may_be_called_as_another_source(self, fabric, tmp_path, monkeypatch):
        fabric.flat([500] * 6)
        type(fabric)(tmp_path / "file").flat([480] * 6)
        monkeypatch.chdir(tmp_path)
        found = Frames(fabric.results, Request(compare=("file", "results")))
        (one,) = found.comparisons.to_dict("records")
        # Returns of a file of curves have no margin.
        assert (one["a"], one["algo"], one["verdict"]) == ("./file", "TD3", "similar")

    def test_shipped_results_are_a_side_by_their_name(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        assert Request(compare=("reference", "tau=0.5")).names_compared == {"tau"}

    def test_directory_without_equal_runs_is_refused(self, fabric, tmp_path):
        fabric.run(FLAT)
        (tmp_path / "empty").mkdir()
        type(fabric)(tmp_path / "other").run(FLAT, time_limit="terminal")
        says = {"empty": r"no run with an episode of .*empty"}
        says["other"] = r"time_limit=bootstrap.*time_limit=terminal"  # what differs
        for name, match in says.items():
            sides = str(tmp_path / "results"), str(tmp_path / name)
            with pytest.raises(RequestError, match=match):
                Frames(fabric.results, Request(compare=sides))


class TestReference:
    def test_shipped_runs_are_separate_configurations(self, fabric, tmp_path):
        shipped = type(fabric)(tmp_path / "reference")
        fabric.flat([500] * 2)
        shipped.flat([500] * 2)
        shipped.run(FLAT, algo="sac")
        found = sources.reference(Request(), shipped.results)
        assert [(c.source, c.algo, len(c.seeds)) for c in found.configurations] == [
            ("reference", "sac", 1),
            ("reference", "td3", 2),
        ]
        assert sources.reference(Request(algo=("td3",)), shipped.results).configurations != []
        assert sources.reference(Request(algo=("ppo",)), shipped.results).configurations == []
        # The date selects the user's own runs.
        later = Request(since="2999-01-01")
        assert len(sources.reference(later, shipped.results).configurations) == 2

    def test_shipped_runs_are_not_added_to_themselves(self):
        with pytest.raises(RequestError, match="that --results reference has; leave it out"):
            Frames(shipped_results(), Request(reference=True))

    def test_missing_reference_runs_are_noted(self, tmp_path):
        for directory in (tmp_path / "nowhere", tmp_path):
            found = sources.reference(Request(), Results(directory))
            assert found.configurations == []
            assert "ships no reference runs" in found.notes[-1]


def test_runs_of_several_algorithms_are_chosen_and_no_others_are_read(fabric, monkeypatch):
    for algo in ("td3", "sac", "ddpg"):
        fabric.flat([500] * 2, algo=algo)

    read = []
    original = Record.read

    def noted(record, *arguments):
        read.append(record.settings["algo"])
        return original(record, *arguments)

    monkeypatch.setattr(Record, "read", noted)
    chosen = sources.own(fabric.results, Request(algo=("td3", "sac")))
    assert {config.algo for config in chosen.configurations} == {"td3", "sac"}
    assert {*read} == {"td3", "sac"}
    with pytest.raises(RequestError, match=r"no runs of algo 'ppo'.*with ddpg, sac, td3\.$"):
        sources.own(fabric.results, Request(algo=("ppo",)))
