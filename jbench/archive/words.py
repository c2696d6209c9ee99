"""Words that tell who made results: those of a machine, and of names of code."""

import getpass
import os
import platform
import re
import socket
import subprocess
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

from jbench.archive.requirements import requirements_text

_SAYS_NOTHING = {"root", "user", "admin", "localhost", "home", "tmp", "results", "main"}
_SHORTEST = 3  # letters of a word that is looked for


def may_name_something(part: str) -> bool:
    """Returns whether a part of a name is looked for: not a word of jbench's code, such as make."""
    return len(part) > _SHORTEST and part.lower() not in _words_of_every_archive()


@cache
def _words_of_every_archive() -> frozenset[str]:
    """Returns words that an archive has whoever made it, in lower case.

    They are those of jbench's code and page, without those on the paper, and of the names of the
    packages that it needs.
    """
    package = Path(__file__).parents[1]
    words = _words_in(requirements_text())
    for path in package.rglob("*"):
        is_text = path.suffix in (".py", ".j2", ".js") and path.is_file()
        if is_text and not path.is_relative_to(package / "paper"):
            words |= _words_in(path.read_text(encoding="utf-8"))

    return frozenset(words)


def _words_in(text: str) -> set[str]:
    """Returns the words of a text, in lower case."""
    return set(map(str.lower, re.findall("[A-Za-z0-9]+", text)))


def found_in(words: Iterable[str], text: str) -> Iterator[str]:
    """Yields the words that a text has, in any case, but not as a part of a longer word.

    An accent may be a character of its own, as in the names of files on macOS.
    """
    text = unicodedata.normalize("NFC", text)
    folded = _folded(text)
    for word in words:
        normal = unicodedata.normalize("NFC", word)
        # Most words are not there, which takes a regular expression a hundred times as long.
        if _folded(normal) not in folded:
            continue
        alone = rf"(?<![A-Za-z0-9]){re.escape(normal)}(?![A-Za-z0-9])"
        if re.search(alone, text, re.I):
            yield word


def _folded(text: str) -> str:
    """Returns a text without its cases; regular expressions take an i without a dot for an i."""
    return text.replace("\u0130", "i").replace("\u0131", "i").casefold()


def words_of_this_machine(*places: Path) -> set[str]:
    """Returns the words that name this machine, its user, its directories and its git remote.

    The name of a user, host or remote that is also a word of jbench's code, such as max, is only
    looked for in the names of directories, since every archive has that word.
    """
    directories = {str(place.absolute()) for place in (Path.cwd(), *places)}
    words = directories | {
        _quietly(getpass.getuser),
        os.environ.get("USER", ""),
        os.environ.get("LOGNAME", ""),
        str(Path.home()),
        _git("config", "user.name"),
        _git("config", "user.email"),
        _git("rev-parse", "HEAD"),
        _git("rev-parse", "--short=12", "HEAD"),
    }

    for host in (socket.gethostname(), platform.node()):
        words.update((host, host.partition(".")[0]))

    for address in _git("config", "--get-regexp", r"remote\..*\.url").splitlines():
        url = address.partition(" ")[2]
        words.add(url)
        words.update(re.split(r"[:/@]", url.removesuffix(".git"))[-2:])

    return {
        word
        for word in map(str.strip, words)
        if len(word) >= _SHORTEST and word.lower() not in _SAYS_NOTHING | _words_of_every_archive()
    }


def _quietly(read: Callable[[], str]) -> str:
    """Returns what a function reads of this machine, or nothing if it can't."""
    try:
        return read()
    except (OSError, KeyError, ImportError):
        return ""


def _git(*arguments: str) -> str:
    """Returns what git prints, or nothing without git or a repository."""
    command = ["git", *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=10).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        return ""
