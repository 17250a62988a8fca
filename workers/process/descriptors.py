"""The process's limit of open files."""

from __future__ import annotations

import resource

MAX_DESCRIPTORS = 65_536
"""Maximum to which the limit is raised, because some libraries loop over all possible descriptors."""


def raise_descriptor_limit() -> int:
    """Raise the soft limit of open files to the hard one (at most `MAX_DESCRIPTORS`). Returns the limit in force."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    infinite = resource.RLIM_INFINITY
    most = MAX_DESCRIPTORS if hard == infinite else min(hard, MAX_DESCRIPTORS)
    if soft != infinite and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
        return most
    return MAX_DESCRIPTORS if soft == infinite else soft
