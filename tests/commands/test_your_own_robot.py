"""The robot of `docs/your-own-robot.md`, from random data to a report."""

import jbench as api
from tests.command_line import jbench, train
from tests.documentation import code_of

TASK = "two_poles:balance"


def test_robot_of_page_is_collected_encoded_trained_and_reported(tmp_path):
    (tmp_path / "two_poles.py").write_text(code_of("your-own-robot.md", "python"))
    for arguments in (
        ("collect", "--task", TASK, "--steps", "10000"),
        ("train-dae", "--task", TASK, "--latent", "4", "--epochs", "2"),
        train("td3", "full", "--task", TASK),
        train("td3", "dae4", "--task", TASK),
        ("report", "--format", "svg"),
    ):
        done = jbench(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    results = api.open(tmp_path / "results")
    runs = results.runs()
    assert set(zip(runs["task"], runs["representation"], runs["seed"], strict=True)) == {
        (TASK, representation, seed) for representation in ("full", "dae4") for seed in (0, 1)
    }
    assert runs["evaluation_return"].between(0, 1000).all()
    page = (tmp_path / "results" / "report" / "index.html").read_text()
    assert TASK in page
    assert "solved" not in page  # what counts as solved is known of the Jitterbug's tasks only
