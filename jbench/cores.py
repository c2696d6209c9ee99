"""The cores that this process may use, and the threads of libraries."""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
"""Environment of a process that trains: with more threads, sums are rounded differently."""


def cores() -> int:
    """Returns the number of cores available to this process, by affinity and cgroup."""
    if not hasattr(os, "sched_getaffinity"):
        return os.cpu_count() or 1
    return min([len(os.sched_getaffinity(0)), *_quotas()])


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits torch to one thread, so that numbers of small steps do not depend on the cores."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _quotas(
    group: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")
) -> list[int]:
    """Returns the limits in cores of this process's control group, such as a container's."""
    quotas = []
    try:
        # 0::/path; the limits of parent groups apply too.
        lines = group.read_text("utf-8").splitlines()
        (path,) = [line[3:] for line in lines if line.startswith("0::")]
        group_folder = root / path.strip("/")
        for folder in (group_folder, *group_folder.parents):
            limit = folder / "cpu.max"
            if folder.is_relative_to(root) and limit.exists():
                quota, period = limit.read_text("ascii").split()
                if quota != "max":
                    quotas.append(math.ceil(int(quota) / int(period)))
    except (OSError, ValueError):
        pass

    return [max(1, count) for count in quotas]
