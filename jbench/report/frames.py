"""The frames of a report: a tidy table for each of its figures and tables.

A figure, its tooltips, a table of the page, its CSV, LaTeX and Markdown are functions of a frame.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import pandas as pd

from jbench.report import policies
from jbench.report.analysis.compare import comparison_frame, pair_frame
from jbench.report.analysis.decisions import Study, decision_frame, recorded_comparisons
from jbench.report.analysis.profiles import profile_frame
from jbench.report.analysis.schedules import notes_on_remarks
from jbench.report.analysis.verdicts import verdict_frame
from jbench.report.choices import rename, use_choices
from jbench.report.cleaned import cleaned_frame
from jbench.report.configurations import configuration_frame, seed_frame, with_file_means
from jbench.report.curve_frames import (
    curve_frame,
    processor_frame,
    published_frame,
    run_curve_frame,
    sequence_frame,
)
from jbench.report.data.configuration import Configuration, Curves, with_returns
from jbench.report.data.curves import SEQUENCE, read_published
from jbench.report.data.source_names import FILE, IMPORTED
from jbench.report.encoders import encoder_frame, kept_frame, prediction_frame
from jbench.report.headline import headline
from jbench.report.leaderboard import leaderboard
from jbench.report.reading import notes_on, read, tested_claims
from jbench.report.request import Request
from jbench.report.runs import provenance_frame, run_frame
from jbench.report.sides import named_sides
from jbench.report.texts import clean, map_texts
from jbench.store import Results
from jbench.store.tables import published_rows

DEFAULT = Request()  # a report of all runs


class Frames:
    """All that a report on some results shows, or on the file of a request.

    Attributes:
        results: what it reports; None for a file of curves.
        source: what it has read of them, or of the file.
        returns: the kind of return that is shown first, and that of pairs, profiles, predictions.
        made: what the functions that are decorated by `once` have made of the frames.
    """

    def __init__(self, results: Results | None, request: Request = DEFAULT) -> None:
        """Reads the results; a NothingYetError without runs, a WorkError if none can be read."""
        self.request = request
        self.made: dict[Callable[[Frames], Any], Any] = {}
        self.results = results
        self.source, self._compared = read(results, request)
        self._every = self.source.configurations
        self._new_names = rename(self._every, request.names)
        use_choices(self.source, request)
        kinds = {config.returns_name for config in self._every}
        self.returns = request.returns if request.returns in kinds or not kinds else kinds.pop()
        self.metrics = map_texts(self.source.tables["metrics"])
        self.paths = map_texts(self.source.paths)

    def lead(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Returns the rows of a frame that are of the kind of return that is shown first."""
        return frame[frame["returns"] == self.returns]

    # What frames are made of.

    @cached_property
    def _curves(self) -> Curves:
        """The configurations with their learning curves."""
        return [(c, c.curve(self.request.order, self.request.window)) for c in self._every]

    @cached_property
    def _drawn(self) -> Curves:
        """The curves but those that are drawn as published ones are."""
        return [pair for pair in self._curves if not self._is_baseline(pair[0])]

    @cached_property
    def _plain(self) -> Curves:
        """The curves on the plain robot, or on one other."""
        return [pair for pair in self._drawn if pair[0].robots <= 1]

    def _is_baseline(self, config: Configuration) -> bool:
        """Whether a configuration is the imported one that others are drawn beside."""
        return (config.source, config.algo) == (IMPORTED, self.request.baseline)

    @cached_property
    def _trained(self) -> list[Configuration]:
        """The configurations that jbench trained."""
        return [config for config in self._every if config.source != IMPORTED]

    @cached_property
    def _specs(self) -> policies.RecordedSpecs:
        """What is recorded of each task of jbench; those of a file may be anything."""
        return policies.specs_by_task(c for c in self._every if c.source != FILE)

    @cached_property
    def _studies(self) -> Sequence[Study]:
        """The comparisons that the shipped studies plan, and those of the request, by study."""
        return recorded_comparisons(self._trained, files=self.request.study)

    @cached_property
    def _papers(self) -> pd.DataFrame:
        """The paper's curves, unless the request leaves them out."""
        papers = read_published(published_rows())
        return papers if self.request.published == "yes" else papers.iloc[:0]

    @cached_property
    def _papers_on_one_robot(self) -> pd.DataFrame:
        """The paper's curves but that on a sequence of augmented robots."""
        return self._papers[self._papers["figure"] != SEQUENCE]

    @cached_property
    def _by_configuration(self) -> pd.DataFrame:
        """The statistics of all configurations, the baseline included."""
        return configuration_frame(self._curves, self._papers)

    @cached_property
    def _behavior(self) -> tuple[pd.DataFrame, pd.DataFrame, list[str]]:
        """Where evaluated policies were, how fast their motors, and what is wrong with others."""
        return policies.behavior(self.results, self.request.task)

    @cached_property
    def _findings(self) -> tuple[pd.DataFrame, list[str]]:
        """The tests of the paper's claims, and notes on them."""
        return tested_claims(self._trained, self._studies, self.source, self.request, self.results)

    # Sentences.

    @cached_property
    def headline(self) -> str:
        """What was learned, in a sentence or two."""
        leading = self.lead(self._by_configuration)
        common = named_sides(self.request.compare).common if self.request.compare else ""
        compared = self.lead(self.comparisons)
        return clean(headline(self.lead(self.verdicts), leading, compared, common))

    @cached_property
    def notes(self) -> list[str]:
        """Sentences for the reader."""
        _, untested = self._findings
        left_out = policies.without_baseline(self._specs, self.source.tables)
        apart = notes_on_remarks(self.verdicts, self.comparisons)
        notes = (*self.source.notes, *notes_on(self._every), *left_out, *untested, *apart)
        return [*map(clean, notes)]

    @cached_property
    def problems(self) -> list[str]:
        """A sentence on each unreadable record."""
        return [*map(clean, (*self.source.problems, *self._behavior[2]))]

    @property
    def margins(self) -> dict[str, float]:
        """By task, the difference of final returns that is similar; see `Configuration.margin`."""
        return {config.task: config.margin for config in self._every}

    @property
    def interpolated(self) -> set[str]:
        """The kinds of return that seeds of a curve have at different control steps."""
        return {config.returns_name for config, _ in self._plain if config.common.interpolated}

    # Returns.

    @cleaned_frame
    def configurations(self) -> pd.DataFrame:
        """Statistics of each configuration and kind of return, and of all tasks of a file."""
        return with_file_means(self._by_configuration, with_returns(self._every, self.returns))

    @cleaned_frame
    def seeds(self) -> pd.DataFrame:
        """The final return of each seed."""
        return seed_frame(self._every)

    @cleaned_frame
    def curves(self) -> pd.DataFrame:
        """The learning curves across seeds."""
        return curve_frame(self._plain)

    @cleaned_frame
    def run_curves(self) -> pd.DataFrame:
        """The learning curve of each run."""
        return run_curve_frame(self._plain)

    @cleaned_frame
    def processor(self) -> pd.DataFrame:
        """Returns by processor time."""
        return self.lead(processor_frame(self._plain))

    @cleaned_frame
    def sequences(self) -> pd.DataFrame:
        """The curves on sequences of augmented robots, and the authors'."""
        ours = [pair for pair in self._drawn if pair[0].robots > 1]
        return sequence_frame(ours, self._papers.query("figure == @SEQUENCE"))

    @cleaned_frame
    def published(self) -> pd.DataFrame:
        """The paper's curves, and the imported ones that are drawn like them."""
        beside = [pair for pair in self._curves if self._is_baseline(pair[0])]
        papers = self._papers_on_one_robot
        return published_frame(papers, set(self._specs), self.request.algo, beside)

    @cleaned_frame
    def baselines(self) -> pd.DataFrame:
        """The returns of policies without training."""
        return policies.baseline_frame(self._specs, self.source.tables)

    # Their analysis.

    @cleaned_frame
    def decisions(self) -> pd.DataFrame:
        """The sequential test on the planned comparisons."""
        return decision_frame(self._studies)

    @cleaned_frame
    def verdicts(self) -> pd.DataFrame:
        """The verdicts on each representation."""
        return verdict_frame(self._trained, self.decisions, self._studies)

    @cleaned_frame
    def comparisons(self) -> pd.DataFrame:
        """The comparisons of two sides, or of the methods of a file."""
        return comparison_frame(self._compared)

    @cleaned_frame
    def pairs(self) -> pd.DataFrame:
        """The probability of improvement of each pair of configurations."""
        trained = with_returns(self._trained, self.returns)
        return pair_frame(trained, self.lead(self.verdicts))

    @cleaned_frame
    def profiles(self) -> pd.DataFrame:
        """The share of runs above each return."""
        return profile_frame(with_returns(self._every, self.returns))

    @cleaned_frame
    def claims(self) -> pd.DataFrame:
        """The findings on the paper's claims."""
        findings, _ = self._findings
        return findings

    @cleaned_frame
    def leaderboard(self) -> pd.DataFrame:
        """The entries by task and median."""
        leading = self.lead(self._by_configuration).query("source != @FILE")
        by_hand = policies.hand_written_returns(self.source.tables)
        return leaderboard(leading, by_hand, self._papers_on_one_robot, self.request.algo)

    # Encoders, policies and single runs.

    @cleaned_frame
    def encoders(self) -> pd.DataFrame:
        """What encoders lose and predict."""
        encoders = encoder_frame(self.source.tables, self.request.task)
        return encoders.assign(representation=encoders["representation"].replace(self._new_names))

    @cleaned_frame
    def predictions(self) -> pd.DataFrame:
        """Final returns beside what latents predict."""
        return prediction_frame(with_returns(self._trained, self.returns), self.encoders)

    @cleaned_frame
    def kept(self) -> pd.DataFrame:
        """What encoders keep of each feature of the observation."""
        kept = kept_frame(self.source.tables, self.request.task)
        return kept.assign(representation=kept["representation"].replace(self._new_names))

    @cleaned_frame
    def motor(self) -> pd.DataFrame:
        """The distributions of motor velocities of evaluated policies."""
        return self._behavior[0]

    @cleaned_frame
    def positions(self) -> pd.DataFrame:
        """The positions of the robot with evaluated policies."""
        return self._behavior[1]

    @cleaned_frame
    def runs(self) -> pd.DataFrame:
        """A row for each run."""
        return run_frame(self.source, self.returns)

    @cleaned_frame
    def provenance(self) -> pd.DataFrame:
        """The recorded versions and processors, with numbers of runs."""
        return provenance_frame(self.runs)
