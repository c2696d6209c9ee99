"""A user's task, encoder, update rule, agent and training loop, each with its own other files.

Each module imports another one beside it, and reads a data file. They are made in a folder, where
commands run. Episodes have 100 control steps.
"""

import hashlib
import json
import re
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from jbench.settings.base import settings_hash
from jbench.store import Results
from tests.command_line import TRAINING, Process, jbench

ROBOT = '''
"""A point that is pushed to the origin."""
from pathlib import Path

import dm_env
import numpy as np
from dm_env import specs

from robot_reward import WIDTH

GOAL = np.load(Path(__file__).parent / "robot_goal.npy")


class Robot(dm_env.Environment):
    def __init__(self, random=None):
        self.random = np.random.RandomState(random)

    def observation_spec(self):
        return {"place": specs.Array((3,), float)}

    def action_spec(self):
        return specs.BoundedArray((1,), float, -1, 1)

    def reset(self):
        self.place, self.made = self.random.uniform(-1, 1, 3), 0
        return dm_env.restart({"place": self.place})

    def step(self, action):
        self.made += 1
        self.place = 0.9 * self.place + 0.1 * action
        reward = 1.0 * np.exp(-np.square(self.place - GOAL).sum() / WIDTH) / 3
        end = dm_env.truncation if self.made == 100 else dm_env.transition
        return end(float(reward), {"place": self.place})
'''

ENCODER = '''
"""Two numbers of the observation."""
import numpy as np

from encoder_scale import WIDTH
from jbench.encoders.kind import Fitted

START = np.load("encoder_goal.npy")


class Two(Fitted):
    def fit(self, states, latents):
        return {"scale": START[:1] + 1.0 * WIDTH}

    def encode(self, weights, scaled):
        return scaled[..., :2] * weights["scale"]

    def decode(self, weights, latents):
        return latents[..., [0, 1, 1]]
'''

RULE = '''
"""A critic and an actor of one layer."""
import numpy as np
from torch import nn

import jbench
from rule_loss import WIDTH

GOAL = float(np.load("rule_goal.npy")[0])


class Rule(jbench.Rule):
    losses = {"critic_loss": "critic", "actor_loss": "actor"}

    def __init__(self, settings, observation_size, action_size):
        super().__init__(settings, observation_size, action_size)
        self.actor = nn.Sequential(nn.Linear(observation_size, action_size))
        self.critic = nn.Sequential(nn.Linear(observation_size + action_size, 1))

    def explore(self, observations, noise):
        return self.actor(observations).tanh()

    def critic_loss(self, batch):
        error = self.critic(batch.state_actions) - WIDTH * batch.rewards
        return 1.0 * error.square().mean()

    def actor_loss(self, batch):
        return (self.actor(batch.observations).tanh() - GOAL).square().mean()
'''

AGENT = '''
"""A linear policy that changes at random."""
import numpy as np
import torch
from torch import nn

import jbench
from agent_noise import WIDTH

START = np.load("agent_goal.npy")


class Agent(jbench.Agent):
    class Settings(jbench.AgentSettings):
        pass

    def __init__(self, settings, environment, seed, device):
        self.random = np.random.default_rng(seed)
        self.weights = np.zeros((1, environment.observation_size)) + START[0]

    def explore(self, observations):
        return self.act(observations)

    def act(self, observations):
        return np.tanh(1.0 * observations @ self.weights.T)

    def learn(self, transition):
        self.weights = self.weights + WIDTH * self.random.normal(0, 0.01, self.weights.shape)
        return {}

    def policy(self):
        linear = nn.Linear(self.weights.shape[1], 1, bias=False)
        linear.weight.data = torch.as_tensor(self.weights, dtype=torch.float32)
        return nn.Sequential(linear, nn.Tanh())

    def state(self):
        return {"weights": self.weights, "random": self.random.bit_generator.state}

    def restore(self, state):
        self.weights = state["weights"]
        self.random.bit_generator.state = state["random"]
'''

LOOP = '''
"""A training loop that records two runs of a task of its own."""
import sys

import jbench
from torch import nn

for seed in range(int(sys.argv[1])):
    about = {"algo": "loop", "seed": seed, "steps": 200, "evaluate_episodes": 1}
    with jbench.record("robot:Robot", **about) as recording:
        env = recording.env()
        for _ in range(2):
            env.reset()
            ended = False
            while not ended:
                *_, ended, _ = env.step([0.1])
        recording.keep_policy(nn.Sequential(nn.Linear(3, 1), nn.Tanh()))
'''

IMPORTS = {"robot": "robot_reward", "encoder": "encoder_scale", "rule": "rule_loss"}
IMPORTS["agent"] = "agent_noise"
MODULES = {"robot": ROBOT, "encoder": ENCODER, "rule": RULE, "agent": AGENT}

KINDS = ("task", "encoder", "rule", "agent", "loop")
EDITS = ("module", "import", "data")

TASK = ("--task", "robot:Robot")
SHORT_RUN = ("--steps", "200", "--evaluate-episodes", "1", "--evaluate-every", "100")


class Project:
    """A folder with code and results of one kind of user's code."""

    def __init__(self, folder, kind):
        self.folder, self.kind = folder, kind
        self.results = folder / "results"
        self.owner = "robot" if kind in ("task", "loop") else kind

    @classmethod
    def new(cls, folder, kind):
        """Writes the code of all kinds, and makes two runs."""
        folder.mkdir(parents=True)
        for name, text in MODULES.items():
            (folder / f"{name}.py").write_text(text)
            (folder / f"{IMPORTS[name]}.py").write_text("WIDTH = 1.0\n")
            np.save(folder / f"{name}_goal.npy", np.zeros(3))
        (folder / "loop.py").write_text(LOOP)
        project = cls(folder, kind)
        project.make()
        return project

    def copy(self, folder):
        shutil.copytree(self.folder, folder)
        return Project(folder, self.kind)

    def edit(self, what):
        """Changes the module, the one that it imports, or its data; returns the file's name."""
        if what == "data":
            path = self.folder / f"{self.owner}_goal.npy"
            np.save(path, np.full(3, 0.5))
            return path.name
        name = self.owner if what == "module" else IMPORTS[self.owner]
        path = self.folder / f"{name}.py"
        path.write_text(path.read_text().replace("1.0", "2.0"))
        return path.name

    def comment(self):
        """Adds comments, docstrings and blank lines to all modules."""
        for path in self.folder.glob("*.py"):
            text = path.read_text().replace("WIDTH = 1.0\n", "WIDTH   =   (1.0)  # m\n")
            path.write_text(f'"""Another docstring."""\n\n\n# A comment\n{text}')

    def type(self, *arguments):
        """Runs a command in the folder; returns it with its exit code and both outputs."""
        return jbench(*arguments, cwd=self.folder)

    def succeed(self, *arguments):
        done = self.type(*arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        return done

    def training(self, *more):
        """Arguments of `jbench train`, of two seeds unless others are typed."""
        seeds = () if "--seeds" in more else ("--seeds", "0-1")
        algorithms = {"rule": ("--algo", "rule:Rule"), "agent": ("--algo", "agent:Agent")}
        algorithm = algorithms.get(self.kind, ("--algo", "td3"))
        encoder = ("--encoder", "two2" if self.kind == "encoder" else "none")
        small = () if self.kind == "agent" else TRAINING["td3"]
        if self.kind == "rule":
            small = small[2:]  # it has no hidden layers to choose
        steps = () if "--steps" in more else SHORT_RUN[:2]
        return ("train", *TASK, *algorithm, *encoder, *small, *steps, *SHORT_RUN[2:], *seeds, *more)

    def make(self, *more):
        """Makes what is missing, up to the runs; returns what was printed."""
        if self.kind == "loop":
            done = Process("tests.user_code:run_loop", "2", cwd=self.folder)
            done = done.finished()
            assert done.returncode == 0, done.stderr
            return done.stdout + done.stderr
        printed = ""
        if self.kind == "encoder":
            printed += self.succeed("collect", *TASK, "--steps", "1000").stdout
            kind = ("--kind", "encoder:Two", "--latent", "2")
            printed += self.succeed("train-encoder", *kind, *TASK).stdout
        return printed + self.succeed(*self.training("--keep-state", *more)).stdout

    def age(self):
        """Makes the runs like those of versions that recorded the checksum of one module only."""
        for record in self.runs().values():
            manifest = json.loads((record.path / "manifest.json").read_text())
            settings, made = manifest["settings"], manifest["provenance"]
            del settings["specs"]["sources"]
            settings.pop("sources", None)
            for key in ("task_sources", "sources", "task_compiled", "encoder_sources"):
                made.pop(key, None)
            stem = record.id.rpartition("-")[0]
            manifest["id"] = f"{stem}-{settings_hash(settings)}"
            rows = [part["name"] for part in manifest["files"] if part["table"]]
            for name in rows:
                _rename(record.path / name, manifest)
            (record.path / "manifest.json").write_text(json.dumps(manifest))
            record.path.rename(self.results / "runs" / manifest["id"])

    def runs(self):
        """Returns the records of the runs by id."""
        return {record.id: record for record in Results(self.results).scan("run")[0]}

    def manifests(self):
        """Returns the bytes of all manifests by path."""
        return {path: path.read_bytes() for path in self.results.rglob("manifest.json")}

    def document(self, *arguments):
        return json.loads(self.succeed(*arguments, "--json").stdout)


def _rename(path, manifest):
    """Gives the rows of a file the run's new id, and the manifest the file's checksum."""
    rows = pq.read_table(path)
    column = rows.schema.get_field_index("run")
    values = pa.array([manifest["id"]] * len(rows)).cast(rows.schema.field(column).type)
    pq.write_table(rows.set_column(column, rows.schema.field(column), values), path)
    entry = next(part for part in manifest["files"] if part["name"] == path.name)
    content = path.read_bytes()
    entry["sha256"], entry["bytes"] = hashlib.sha256(content).hexdigest(), len(content)


def run_loop(seeds):
    """Runs the training loop of the working directory, as Python does."""
    import runpy
    import sys

    sys.path.insert(0, ".")
    sys.argv = ["loop.py", seeds]
    runpy.run_path("loop.py", run_name="__main__")
    return 0


def words(text):
    """Returns a text as one line, since tables and sentences are wrapped."""
    return re.sub(r"\s+", " ", text)
