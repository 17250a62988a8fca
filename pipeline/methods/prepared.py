"""Features of frames that tasks of their own prepare for a chain of tasks: optical flow, for example, which depends on
the source only, while the chain passes a state on from run to run. So that several workers help a single shot.

A preparing task computes the features of one run of the chain and saves them as the artefact of its own key. It may
begin while the chain is at most `LEAD` runs behind, fewer where these take more than `MOST_BYTES`, so that few features
wait. Where features cost less to compute than to store, read, and decode frames for once more (`costs_more`), the chain
computes them itself, as a live session does, with the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.methods.tasks import Task, TaskResult

LEAD = 4
"""Runs of a chain for which features are prepared ahead."""
MOST_BYTES = 512 << 20
"""Size of the features that wait, bytes; those of two runs may take more."""
STORED_NS_PER_BYTE = 1.9
"""Processor time of storing and reading features on a disk, measured with arrays of 2 to 22 MB."""
DECODED_NS_PER_PX = 6.0
"""Processor time of decoding a pixel of the source once more, measured with H.264 and VP9."""


def costs_more(compute_ns: float, frame_bytes: int, frame_px: int) -> bool:
    """Whether features of a frame take longer to compute than to keep for another task.

    Args:
        compute_ns: processor time of computing them, ns.
        frame_bytes: their size; frame_px: pixels of a frame of the source.
    """
    return compute_ns > STORED_NS_PER_BYTE * frame_bytes + DECODED_NS_PER_PX * frame_px


def with_prepared(chain: Sequence[Task], name: str, weight: float, frame_bytes: int) -> list[list[Task]]:
    """A chain of runs with tasks that prepare them: for each run of the chain the tasks that workers should prefer at
    that point, the run itself last.

    Args:
        chain: tasks with the arguments "start" and "stop", in order; the first one of a shot waits for none.
        name: first part of the preparing tasks' keys.
        weight: of a preparing task, for each frame.
        frame_bytes: size of the features of a frame.
    """
    prepared: list[Task] = []
    shot = 0
    for place, run in enumerate(chain):
        shot = place if not run.after else shot
        frames = run.args["stop"] - run.args["start"]
        lead = min(LEAD, max(2, MOST_BYTES // max(1, frames * frame_bytes)))
        after = (chain[place - lead].key,) if place - lead >= shot else ()
        args: TaskResult = {"start": run.args["start"], "stop": run.args["stop"], "first": place == shot}
        prepared.append(Task(prepared_key(name, run.args["start"]), args, after, weight=weight * frames))
    waiting = [replace(run, after=(*run.after, own.key)) for run, own in zip(chain, prepared, strict=True)]
    ahead = [*prepared[1:], None]
    first = prepared[:1]
    return [
        [*(first if not place else []), *([] if later is None else [later]), run]
        for place, (later, run) in enumerate(zip(ahead, waiting, strict=True))
    ]


def prepared_key(name: str, start: int) -> str:
    """Key of the task that prepares the run that starts at frame `start`, and of its artefact."""
    return f"{name}-{start:07d}"
