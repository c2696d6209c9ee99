"""What a power cut can leave of a commit: its system calls, and the states in which some are lost.

The method is that of ALICE (Pillai et al., OSDI 2014) with the weakest file system: until `fsync`
of a file, its content may be empty, cut short or whole, and until `fsync` of a directory, any of
its new, renamed and removed names may be as before, whatever came later. Renames are atomic.
"""

import itertools
import os
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

MAX_PENDING = 8
"""Most operations on names of which every subset is tried; of more, only those up to a cut."""


@dataclass(frozen=True)
class Name:
    """An operation on names: `path` becomes `inode`, None if it is removed, and `source` goes."""

    path: str
    inode: int | None
    source: str | None = None
    is_directory: bool = False

    @property
    def directories(self):
        """The directories that must be synced."""
        paths = [self.path] if self.source is None else [self.path, self.source]
        return {os.path.dirname(path) for path in paths}


@dataclass(frozen=True)
class Written:
    """The content of a new file, which is not synced yet."""

    inode: int
    content: bytes


@dataclass(frozen=True)
class Synced:
    """A file (by inode) or a directory (by path) that was synced."""

    what: int | str


@dataclass
class Recording:
    """The calls of a commit below a directory, in their order, and the files before it."""

    root: Path
    files: dict[str, bytes] = field(default_factory=dict)
    directories: set[str] = field(default_factory=set)
    calls: list[Name | Written | Synced] = field(default_factory=list)
    inodes: dict[str, int] = field(default_factory=dict)
    known: set[int] = field(default_factory=set)  # inodes whose content was recorded

    def syncs(self):
        """Returns how many files and how many directories were synced."""
        synced = [call.what for call in self.calls if isinstance(call, Synced)]
        return Counter("file" if isinstance(what, int) else "directory" for what in synced)

    def name(self, path):
        """Returns a path relative to the directory, or None if it is elsewhere."""
        path = os.path.realpath(path)
        root = os.path.realpath(self.root)
        return os.path.relpath(path, root) if path.startswith(f"{root}{os.sep}") else None

    def new(self, path):
        """Records a new file."""
        if (name := self.name(path)) is not None:
            self.inodes[name] = len(self.files) + len(self.inodes) + 1000
            self.calls.append(Name(name, self.inodes[name]))

    def write(self, path):
        """Records the content of a new file, once it is complete."""
        name = self.name(path)
        inode = self.inodes.get(name)
        if inode is not None and inode not in self.known:
            self.known.add(inode)
            self.calls.append(Written(inode, Path(path).read_bytes()))

    def sync(self, handle):
        """Records the sync of an open file or directory."""
        path = os.readlink(f"/proc/self/fd/{handle}")
        if os.path.realpath(path) == os.path.realpath(self.root):
            self.calls.append(Synced(""))
        elif (name := self.name(path)) is not None:
            self.write(path)
            self.calls.append(Synced(name if os.path.isdir(path) else self.inodes[name]))

    def rename(self, source, path):
        """Records a rename."""
        self.write(source)
        before, after = self.name(source), self.name(path)
        if after is not None:
            inode = self.inodes.pop(before, None)
            self.inodes[after] = inode
            self.calls.append(Name(after, inode, before))

    def link(self, source, path):
        """Records a second name of a file."""
        before, after = self.name(source), self.name(path)
        if after is not None:
            self.inodes[after] = self.inodes[before]
            self.calls.append(Name(after, self.inodes[before]))

    def remove(self, path):
        """Records the removal of a file."""
        if (name := self.name(path)) is not None:
            self.inodes.pop(name, None)
            self.calls.append(Name(name, None))

    def make(self, path):
        """Records a new directory."""
        if (name := self.name(path)) is not None:
            self.calls.append(Name(name, None, is_directory=True))


def _snapshot(recording):
    for path in sorted(recording.root.rglob("*")):
        name = path.relative_to(recording.root).as_posix()
        if path.is_dir():
            recording.directories.add(name)
        else:
            recording.files[name] = path.read_bytes()
            recording.inodes[name] = len(recording.inodes)
            recording.known.add(recording.inodes[name])


@contextmanager
def recorded(root):
    """Records the calls below a directory inside the block; yields the `Recording`."""
    recording = Recording(Path(root))
    _snapshot(recording)
    hooks = {
        "fsync": recording.sync,
        "replace": recording.rename,
        "rename": recording.rename,
        "unlink": recording.remove,
        "mkdir": recording.make,
        "link": recording.link,
    }
    opened = os.open

    def open_(path, flags, *mode, **options):
        handle = opened(path, flags, *mode, **options)
        if flags & os.O_EXCL:
            recording.new(path)
        return handle

    def hooked(name):
        function, hook = getattr(os, name), hooks[name]

        def call(*arguments, **options):
            before = name in ("replace", "rename", "fsync")
            if before:
                hook(*arguments)
            result = function(*arguments, **options)
            if name == "link":
                hook(*arguments)
            elif not before:
                hook(arguments[0])
            return result

        return mock.patch.object(os, name, call)

    with mock.patch.object(os, "open", open_):
        patches = [hooked(name) for name in hooks]
        for patch in patches:
            patch.start()
        try:
            yield recording
        finally:
            for patch in patches:
                patch.stop()


def states(recording):
    """Yields every state that a cut can leave: its files (content by path) and directories."""
    seen = set()
    for cut in range(len(recording.calls) + 1):
        for state in _states_at(recording, recording.calls[:cut]):
            key = frozenset(state[0].items()), frozenset(state[1])
            if key not in seen:
                seen.add(key)
                yield state


def _states_at(recording, calls):
    names = [(at, call) for at, call in enumerate(calls) if isinstance(call, Name)]
    synced = [(at, call.what) for at, call in enumerate(calls) if isinstance(call, Synced)]

    def is_kept(at, call):
        return all(
            any(later > at and what == directory for later, what in synced)
            for directory in call.directories
        )

    pending = [call for at, call in names if not is_kept(at, call)]
    contents = {call.inode: call.content for call in calls if isinstance(call, Written)}
    durable = {what for _, what in synced}
    loose = [inode for inode in contents if inode not in durable]
    subsets = itertools.product((False, True), repeat=len(pending))
    if len(pending) > MAX_PENDING:
        subsets = ([at < most for at in range(len(pending))] for most in range(len(pending) + 1))
    for chosen in subsets:
        lost = {id(call) for call, is_there in zip(pending, chosen, strict=True) if not is_there}
        for lengths in itertools.product((0.0, 0.5, 1.0), repeat=len(loose)):
            cut = dict(zip(loose, lengths, strict=True))
            yield _apply(recording, [c for _, c in names if id(c) not in lost], contents, cut)


def _apply(recording, names, contents, cut):
    """Returns the files and directories after some operations, with contents cut short."""
    initial = dict(zip(recording.files, range(len(recording.files)), strict=True))
    contents = {**dict(enumerate(recording.files.values())), **contents}
    entries, directories = dict(initial), set(recording.directories)
    for call in names:
        entries.pop(call.source, None)
        if call.is_directory:
            directories.add(call.path)
        elif call.inode is None and call.source is None:
            entries.pop(call.path, None)
        else:
            entries[call.path] = call.inode
    there = {
        path: contents.get(inode, b"")[: round(len(contents.get(inode, b"")) * cut.get(inode, 1.0))]
        for path, inode in entries.items()
        if _exists(os.path.dirname(path), directories)
    }
    return there, {each for each in directories if _exists(each, directories)}


def _exists(directory, directories):
    """Returns whether a directory and all above it are there."""
    return not directory or (
        directory in directories and _exists(os.path.dirname(directory), directories)
    )


def put(state, root):
    """Writes the files of a state below an empty directory."""
    files, directories = state
    root.mkdir(parents=True)
    for name in sorted(directories):
        (root / name).mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (root / name).write_bytes(content)
