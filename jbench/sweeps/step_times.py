"""How long a control step of a run takes on this machine, with its share of evaluations."""

import contextlib
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from jbench.cores import cores, one_thread
from jbench.errors import ERRORS_OF_OTHERS
from jbench.settings.engines import ENGINES
from jbench.settings.recorded import COST, SEED, alike, read_run
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.provenance import processor
from jbench.sweeps.batches import batches
from jbench.tasks.find import checked_task
from jbench.training import speed


@dataclass(frozen=True)
class StepTime:
    """How long a control step of a run takes on this machine.

    Attributes:
        seconds: of a core, or of the GPU; None if it is unknown.
        source: "measured runs", "a quick measurement" or "unknown".
    """

    seconds: float | None
    source: str


_UNKNOWN = StepTime(None, "unknown")


class StepTimes:
    """Times of control steps here: measured, or else those of similar finished runs.

    The finished runs may be of a machine with the same name that is slower.
    """

    def __init__(
        self,
        results: Results,
        jobs: int,
        device: str,
        final_episodes: int | None,
        *,
        measures: bool,
    ) -> None:
        """Reads the finished runs; see `cell_statuses` for the arguments."""
        self._jobs = jobs
        self._device = device
        self._final_episodes = final_episodes
        self._measures = measures
        self._finished = _of_finished_runs(results, device)
        self._measured: dict[tuple[str, int], StepTime | None] = {}

    def of(self, run: RunSettings, waiting: Sequence[RunSettings]) -> StepTime:
        """Returns that of a run; it is measured with the runs like it that are to be trained."""
        about = alike(run, COST)
        shape = about, run.steps  # the share of evaluations depends on the steps
        if waiting and self._measures and shape not in self._measured:
            self._measured[shape] = self._measure(waiting)

        known = (
            self._measured.get(shape),
            self._finished.get(alike(run, SEED)),
            self._finished.get(about),
        )
        return next(filter(None, known), _UNKNOWN)

    def evaluating_share(self, run: RunSettings, seconds: float) -> float:
        """Returns the share of a run's time that its evaluations take; 0 if it can't be measured.

        `seconds` is the time of a control step.
        """
        steps = speed.evaluation_steps(run, self._final_episodes)
        if steps <= 1:
            return 0.0
        with contextlib.suppress(*ERRORS_OF_OTHERS):
            stepping = speed.stepping(run, run.evaluate_episodes, device=self._device)
            return min(1.0, steps * stepping / seconds)
        return 0.0

    def _measure(self, runs: Sequence[RunSettings]) -> StepTime | None:
        """Measures temporary agents, as many as the largest process trains; None if it can't be."""
        checked_task(runs[0].task)
        together = batches(runs, self._jobs, self._device)[0]
        try:
            with one_thread():
                seconds = speed.seconds_per_step(
                    together, self._device, final_episodes=self._final_episodes
                )
            return StepTime(seconds / len(together), "a quick measurement")
        except ERRORS_OF_OTHERS:  # the training will say what is wrong, and stop no other run
            return None
        finally:
            torch.cuda.empty_cache()  # the runs need the memory; without a GPU it does nothing


def _of_finished_runs(results: Results, device: str) -> dict[str, StepTime]:
    """Returns those of finished runs here, by their keys `alike` for SEED and for COST."""
    seconds: dict[str, list[float]] = {}
    for record in results.scan("run")[0]:
        summary = record.manifest.summary
        time = summary.get("wall_time")
        steps = summary.get("steps_done")
        if record.is_finished and time and steps and _was_made_here(record, device):
            run = read_run(record.settings)
            with contextlib.suppress(TypeError):  # manifests of others may hold anything
                # The runs of a process share a core, and each records the whole time.
                per_step = time / steps / (summary.get("together") or 1)
                if device == "cpu" and summary.get("processor_time"):
                    per_step = summary["processor_time"] / steps  # without other work
                for free in (SEED, COST):
                    seconds.setdefault(alike(run, free), []).append(per_step)

    return {
        key: StepTime(statistics.median(measured), "measured runs")
        for key, measured in seconds.items()
    }


def _was_made_here(record: Record, device: str) -> bool:
    """Returns whether a run was trained on this processor, and the device that runs would have."""
    made_on = record.manifest.provenance
    engine = ENGINES.get(str(record.settings.get("engine")))
    now = device.partition(":")[0] if engine is not None and engine.is_for_gpu else "cpu"
    return (
        made_on.get("processor") == processor()
        and made_on.get("cores") == cores()
        and made_on.get("device", "cpu") == now
    )
