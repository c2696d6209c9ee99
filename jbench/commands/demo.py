"""The demo command."""

import shlex
import subprocess
import sys
from functools import partial
from pathlib import Path

from typer import Exit, Option

from jbench.commands import output, parsing

# Smaller networks and batches, and fewer random first steps than the paper's TD3, so that it learns
# in minutes.
_AGENTS = (
    "train --algo td3 --seeds 0-1 --steps 20000 --set hidden_layers=[128,128] "
    "--set batch_size=64 --set learning_rate=1e-3 --set learning_starts=5000 --evaluate-episodes 2 "
    "--final-episodes 2"
)

COMMANDS = (
    "collect --steps 50000",
    "train-dae --latent 14",
    f"{_AGENTS} --encoder none",
    f"{_AGENTS} --encoder dae14",
    "report --window 5",
)
"""The commands of the demo, without `jbench` and `--results`."""

_CURVES = """
    WITH means AS (
        SELECT run, control_steps, avg(episode_return) AS episode_return
        FROM evaluations GROUP BY ALL
    ),
    points AS (
        SELECT representation, control_steps, median(episode_return) AS median, count(*) AS seeds,
            printf('%.0f and %.0f', min(episode_return), max(episode_return)) AS extremes
        FROM means JOIN runs USING (run) WHERE task = 'face_direction' AND algo = 'td3'
        GROUP BY ALL
    )
    SELECT representation, list(median ORDER BY control_steps) AS "learning curve",
        round(arg_max(median, control_steps)) AS "evaluation return",
        arg_max(seeds, control_steps) AS seeds,
        arg_max(extremes, control_steps) AS "lowest and highest"
    FROM points GROUP BY representation ORDER BY representation
"""


def demo(
    results: Path = Option(
        Path("demo-results"), parser=parsing.path, metavar="DIR", help="Results directory."
    ),
) -> None:
    """Run the whole pipeline on a small scale, in minutes.

    It collects a dataset, trains an encoder and agents, and writes a report.
    """
    from jbench.commands.progress import sparkline
    from jbench.store.query import query_results
    from jbench.task_specs import highest_return

    database = parsing.results_to_write(results)
    output.say(
        "jbench demo: TD3 on face_direction, on the full observation and on 14 latents of an\n"
        "autoencoder; networks of [128, 128] instead of the paper's [350, 250], 20,000 steps "
        "instead of 5,000,000."
    )
    output.if_stopped("The same command continues the demo.")

    for command in COMMANDS:
        arguments = [*command.split(), "--results", str(results)]
        output.say(f"$ {shlex.join(['jbench', *arguments])}")
        # What it prints is printed only if it fails.
        process = subprocess.Popen(
            [sys.executable, "-m", "jbench", *arguments],
            stdout=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        try:
            said, _ = process.communicate()
        finally:
            process.wait()  # after Ctrl-C, which stops it as well

        if process.returncode:
            output.say(said.rstrip())
            raise Exit(process.returncode)

    curves = query_results(database, _CURVES).rows
    highest = highest_return("face_direction")
    curves["learning curve"] = curves["learning curve"].map(partial(sparkline, highest=highest))
    if len(curves):
        title = "Evaluation returns as the agents learn, median over seeds (a full bar is 1,000)"
        output.frame(title, curves)

    output.say(
        "Two seeds decide nothing: this shows that everything works, not which observation is "
        "better.\n"
        f"Open {results / 'report' / 'index.html'} in a browser. The paper's experiment on one "
        "task takes days:\n"
        "  jbench collect && jbench train-dae && jbench train && jbench train --encoder dae12 && "
        "jbench report"
    )
