"""Builds the documentation site, strictly: python docs/build_site.py, or make docs.

The site is the Markdown of this folder with the README as its first page, and four generated
parts: the reference of the commands, that of the Python API, the columns of the database, and the
report of the shipped runs.
It works offline: a page that would request something from elsewhere fails the build.
"""

import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from jbench.store.schema import FILES

ROOT = Path(__file__).resolve().parents[1]
STAGE = ROOT / "build" / "site-source"
SITE = ROOT / "build" / "site"

RESULTS_PAGE = """# The shipped runs

jbench comes with its own runs. `jbench report --results reference --claims` wrote [their
report](reference/index.html), of which these are the main parts:

- [Does reduction help?](reference/index.html#reduction) Verdicts on each representation; a click on
  a verdict shows its numbers.
- [Final returns](reference/index.html#returns) of each seed, with intervals, and the same [as a
  table](reference/index.html#table-final_returns).
- [Runs](reference/index.html#table-runs). A click on a run shows its curve, settings and origin.

`report.md` and `claims.md` explain the report. `answer.md` says what the runs show, and
`answer-details.md` lists the commands that trained the runs on reduced observations.

![Learning curves of the shipped runs by representation](reference/figures/representations.svg)
"""


def main() -> None:
    """Builds the site into build/site."""
    shutil.rmtree(STAGE, ignore_errors=True)
    shutil.rmtree(SITE, ignore_errors=True)
    pages = STAGE / "docs"
    shutil.copytree(ROOT / "docs", pages, ignore=shutil.ignore_patterns("*.py"))
    (pages / "index.md").write_text((ROOT / "README.md").read_text("utf-8"), "utf-8")
    (pages / "contributing.md").write_text((ROOT / "CONTRIBUTING.md").read_text("utf-8"), "utf-8")
    (pages / "commands.md").write_text(command_reference(), "utf-8")
    (pages / "tables.md").write_text(columns_of_tables(), "utf-8")
    (pages / "results.md").write_text(RESULTS_PAGE, "utf-8")
    write_report(pages / "reference")
    titles = {page.name: title_of(page) for page in pages.glob("*.md")}
    for page in pages.glob("*.md"):
        page.write_text(linked(page.read_text("utf-8"), titles), "utf-8")
    config = (ROOT / "zensical.toml").read_text("utf-8")
    check_navigation(tomllib.loads(config)["project"]["nav"], set(titles))
    (STAGE / "zensical.toml").write_text(config, "utf-8")
    subprocess.run([sys.executable, "-m", "zensical", "build", "--strict"], cwd=STAGE, check=True)
    shutil.move(STAGE / "site", SITE)
    problems = [problem for page in sorted(SITE.rglob("*.html")) for problem in faults(page)]
    if problems:
        sys.exit("\n".join(problems))
    print(f"The documentation: {SITE / 'index.html'}")


def command_reference() -> str:
    """Returns the reference of all commands, from their help."""
    typer = [sys.executable, "-m", "typer", "jbench.cli", "utils", "docs", "--name", "jbench"]
    text = subprocess.run(
        [*typer, "--title", "Command reference"], check=True, capture_output=True, text=True
    ).stdout
    # The list of commands shortens each sentence; the table of contents has all names.
    text = re.sub(r"\*\*Commands\*\*:\n\n(\* .*\n)+\n", "", text)
    for verb in ("train-agent",):  # an older name, which the help leaves out
        text = re.sub(rf"(?s)## `jbench {verb}`\n.*?(?=\n## )\n", "", text)
    return re.sub(r"(?m)^Example: (jbench .*)$", r"Example: `\1`", text)


def columns_of_tables() -> str:
    """Returns the page with the columns of all tables of the database and their units."""
    text = "# Columns of the database\n\n`database.md` says what the rows of each table are.\n"
    for table, columns in FILES.items():
        text += f"\n## `{table}`\n\n| column | type | unit |\n|---|---|---|\n"
        for column in columns:
            unit = (column.metadata or {}).get(b"unit", b"").decode()
            text += f"| `{column.name}` | {column.type} | {unit} |\n"
    return text


def write_report(directory: Path) -> None:
    """Writes the report of the shipped runs."""
    report = [sys.executable, "-m", "jbench", "report", "--results", "reference", "--claims"]
    report += ["--format", "svg", "--out", directory.name]  # which the page prints
    subprocess.run(report, cwd=directory.parent, check=True, stdout=sys.stderr)


def title_of(page: Path) -> str:
    """Returns the title of a page."""
    return page.read_text("utf-8").partition("\n")[0].removeprefix("# ")


def linked(text: str, titles: dict[str, str]) -> str:
    """Returns a page whose mentions of other pages are links, as those of the README are.

    Args:
        text: the Markdown of a page.
        titles: titles of all pages by file name.
    """
    text = text.replace("](docs/", "](").replace("](CONTRIBUTING.md", "](contributing.md")
    # Not part of the site.
    text = re.sub(r"\[([^\]]*)\]\(((?:examples|LICENSE|SECURITY|CITATION)[^)]*)\)", r"\1", text)
    # An interval stays in one line of its cell.
    text = re.sub(r"(\[[-+]?[\d.]+,) ([-+]?[\d.]+\])", "\\1\N{NO-BREAK SPACE}\\2", text)

    def link(mention: re.Match[str]) -> str:
        return f"[{titles[mention[1]]}]({mention[1]})" if mention[1] in titles else mention[0]

    return re.sub(r"`(?:docs/)?([\w-]+\.md)`", link, text)


def check_navigation(nav: list[dict[str, Any]], pages: set[str]) -> None:
    """Ends the build unless the navigation lists every page once, and no other."""
    listed = list(_files(nav))
    for page in sorted(pages.symmetric_difference(listed)):
        sys.exit(
            f"{page} is a page without a line in `nav` of zensical.toml."
            if page in pages
            else f"{page} in `nav` of zensical.toml is no page."
        )


def _files(nav: list[dict[str, Any]]) -> Iterator[str]:
    for entry in nav:
        for target in entry.values():
            if isinstance(target, str):
                yield target
            else:
                yield from _files(target)


class _Links(HTMLParser):
    """Collects what a page requests, and the files to which it links."""

    def __init__(self) -> None:
        super().__init__()
        self.requested: list[str] = []
        self.linked: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Sorts the addresses of a tag."""
        values = dict(attrs)
        address = values.get("src") or values.get("href") or ""
        if tag == "a" or values.get("rel") in ("canonical", "next", "prev"):
            self.linked.append(address)
        elif address and tag in ("script", "img", "link", "iframe", "source"):
            self.requested.append(address)


def faults(page: Path) -> list[str]:
    """Returns what is wrong with a built page: requests to elsewhere, links to nothing."""
    found = _Links()
    found.feed(page.read_text("utf-8"))
    name = page.relative_to(SITE)
    outside = [one for one in found.requested if re.match(r"(https?:)?//", one)]
    wrong = [f"{name} requests {address}." for address in outside]
    for address in found.linked:
        target = address.partition("#")[0]
        if target and not re.match(r"[a-z]+:|//|/", target) and not (page.parent / target).exists():
            wrong.append(f"{name} links to {address}, which is not there.")
    return wrong


if __name__ == "__main__":
    main()
