"""Finds the code blocks of Markdown pages, and runs them."""

import io
import os
import re
import subprocess
import sys
import tomllib
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import duckdb
from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "jbench" / "SKILL.md",
    *sorted((ROOT / "docs").glob("*.md")),
]

MARK = re.compile(r"<!-- illustration: (\S.*) -->\n?")
PROGRAMS = ("jbench", "make", "pip", "python", "ray")
LANGUAGES = ("python", "sh", "sql", "toml")


@dataclass(frozen=True)
class Block:
    """A block of code on the page with this name."""

    page: str
    line: int
    kind: str | None  # one of `LANGUAGES`, or "console" for a command and what it prints
    text: str
    illustration: str | None  # why it is not run

    @property
    def commands(self):
        """The shell commands, one after the other."""
        if self.kind == "sh":
            return self.text
        typed = re.findall(r"^\$ (.*(?:\n +.*|\\\n.*)*)", self.text, re.M)
        return "\n".join(_until_quotes_close(command) for command in typed)

    @property
    def output(self):
        """The printed lines below the command of a console block."""
        return self.text.removeprefix(f"$ {self.commands}\n")


def blocks_of(page, text):
    """Returns the blocks of a page in their order.

    Raises:
        ValueError: if a block of unknown kind is not an illustration, or a mark has no block.
    """
    found, mark = [], None
    for token in MarkdownIt().enable("table").parse(text):
        if token.type in ("fence", "code_block"):
            line, kind = token.map[0] + 1, _kind(token.info.strip(), token.content)
            if kind is None and mark is None:
                raise ValueError(
                    f"{page}:{line}: a block of an unknown kind: give it one of the languages "
                    f"{', '.join(LANGUAGES)}, or write <!-- illustration: why --> above it"
                )
            found.append(Block(page, line, kind, token.content, mark))
            mark = None
        elif mark is not None and token.level == 0:
            raise ValueError(f"{page}: no block of code below the mark of {mark!r}")
        elif token.type == "html_block" and (message := MARK.fullmatch(token.content)):
            mark = message[1]
    return found


def code_of(page, kind, part=""):
    """Returns the text of the first block of a kind, with a part, on a page of docs/."""
    text = (ROOT / "docs" / page).read_text()
    blocks = (block.text for block in blocks_of(page, text) if block.kind == kind)
    return next(block for block in blocks if part in block)


def _kind(language, text):
    if language or not text.strip():
        return language if language in LANGUAGES else None
    if text.startswith("$ "):
        return "console"
    begins = [line for line in text.splitlines() if line.strip() and not line.startswith(" ")]
    return "sh" if all(line.split()[0] in PROGRAMS for line in begins) else None


def _until_quotes_close(command):
    """Returns the lines of a command without those that it printed, which may be indented too."""
    lines = command.split("\n")
    for end in range(1, len(lines) + 1):
        typed = "\n".join(lines[:end])
        if typed.count('"') % 2 == 0 and not typed.endswith("\\"):
            return typed
    return command


class Session:
    """Runs the code blocks of a page in order.

    Python blocks share their variables, shell blocks their directory. `jbench` is this checkout's.

    Attributes:
        directory: working directory, with the reference runs at the path that a checkout has.
        outputs: what the blocks printed, by their line.
    """

    def __init__(self, directory):
        self.directory, self.names, self.outputs = directory, {"__name__": "page"}, {}
        programs = directory / "bin"
        programs.mkdir()
        jbench = programs / "jbench"
        jbench.write_text(
            f"#!{sys.executable}\nimport sys\nsys.path[0] = {str(ROOT)!r}\n"
            "from jbench.cli import main\nsys.exit(main(sys.argv[1:]))\n"
        )
        jbench.chmod(0o755)
        path = f"{programs}{os.pathsep}{os.environ['PATH']}"
        self.environment = {**os.environ, "PATH": path}
        (directory / "jbench").mkdir()
        (directory / "jbench" / "reference").symlink_to(ROOT / "jbench" / "reference")

    def run(self, block):
        """Runs a block and keeps its output; a failing block raises an error."""
        self.outputs[block.line] = getattr(self, f"_{block.kind}")(block)

    def _python(self, block):
        code = compile(block.text, f"{block.page}:{block.line}", "exec")
        # The page's own lines, as a reader would run them.
        with redirect_stdout(io.StringIO()) as printed:
            exec(code, self.names)  # noqa: S102
        return printed.getvalue()

    def _sh(self, block):
        command, where = ["bash", "-e", "-c", block.commands], {"cwd": self.directory}
        where["env"] = self.environment
        where["timeout"] = 300
        done = subprocess.run(command, **where, capture_output=True, text=True)
        assert done.returncode == 0, f"{block.page}:{block.line}: {done.stderr}"
        return done.stdout

    def _console(self, block):
        printed = self._sh(block)
        # A page leaves out the margins of a table.
        lines = [line.rstrip() for line in printed.split("\n") if line.strip()]
        assert lines == block.output.splitlines(), f"{block.page}:{block.line}"
        return printed

    def _sql(self, block):
        return duckdb.connect().execute(block.text).fetchall()

    def _toml(self, block):
        return tomllib.loads(block.text)
