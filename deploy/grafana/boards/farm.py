"""Dashboard of the farm: queue, throughput, workers, failures."""

from __future__ import annotations

from deploy.grafana.panels import RATE, Board, Line, graph, stat

FARM = Board(
    "farm",
    "Farm",
    "Queue, throughput, workers and failures of the farm.",
    (
        (
            "Now",
            (
                stat(
                    "Tasks ready",
                    "Tasks that could run now: their dependencies are done.",
                    "short",
                    "max(impasto_queue_ready_tasks)",
                ),
                stat(
                    "Oldest queued job",
                    "Time since it was queued. An alert fires above one hour.",
                    "s",
                    "max(impasto_queue_oldest_seconds)",
                    limits=((600, "yellow"), (3600, "red")),
                ),
                stat(
                    "Running attempts",
                    "Task attempts that run now in the whole farm.",
                    "short",
                    "max(impasto_attempts_running)",
                ),
                stat(
                    "Workers",
                    "Workers that are available, busy ones included.",
                    "short",
                    "sum(impasto_workers)",
                    limits=((1, "green"),),
                    low_is_bad=True,
                ),
                stat(
                    "Busy",
                    "Busy workers as a share of the available ones.",
                    "percentunit",
                    "sum(impasto_workers_busy) / sum(impasto_workers)",
                ),
                stat(
                    "Failed attempts",
                    "Share of ended attempts that failed. An alert fires above 10 %.",
                    "percentunit",
                    f'sum(rate(impasto_attempts_total{{outcome="failed"}}{RATE}))'
                    f" / sum(rate(impasto_attempts_total{RATE})) or vector(0)",
                    limits=((0.02, "yellow"), (0.1, "red")),
                ),
            ),
        ),
        (
            "Queue",
            (
                graph(
                    "Jobs",
                    "Unfinished jobs by state.",
                    "short",
                    Line('max by (state) (impasto_jobs{state=~"queued|running|paused"})', "{{state}}"),
                    stacked=True,
                ),
                graph(
                    "Tasks",
                    "Unfinished tasks of all jobs by state.",
                    "short",
                    Line('max by (state) (impasto_tasks{state=~"waiting|ready|running"})', "{{state}}"),
                    stacked=True,
                ),
                graph(
                    "Wait of the oldest job",
                    "Time since the oldest queued job was queued. It rises while there is more work than workers.",
                    "s",
                    Line("max(impasto_queue_oldest_seconds)", "oldest"),
                    limits=((3600, "red"),),
                ),
            ),
        ),
        (
            "Throughput",
            (
                graph(
                    "Frames per second",
                    "Finished frames per second, by method.",
                    "short",
                    Line(f"sum by (method) (rate(impasto_frames_total{RATE}))", "{{method}}"),
                    stacked=True,
                ),
                graph(
                    "Attempts",
                    "Attempts ended per second, by outcome. Interrupted means that the worker died.",
                    "short",
                    Line(f"sum by (outcome) (rate(impasto_attempts_total{RATE}))", "{{outcome}}"),
                    stacked=True,
                ),
                graph(
                    "Seconds per frame",
                    "Worker time per finished frame, by method.",
                    "s",
                    Line(
                        f"sum by (method) (rate(impasto_attempt_seconds_total{RATE}))"
                        f" / sum by (method) (rate(impasto_frames_total{RATE}))",
                        "{{method}}",
                    ),
                ),
            ),
        ),
        (
            "Workers and failures",
            (
                graph(
                    "Workers",
                    "Workers that services request, that are available, and that are busy.",
                    "short",
                    Line("sum(impasto_workers_wanted)", "requested"),
                    Line("sum(impasto_workers)", "available"),
                    Line("sum(impasto_workers_busy)", "busy"),
                ),
                graph(
                    "Worker time",
                    "Worker seconds spent per second, by method: the mean number of busy workers.",
                    "short",
                    Line(f"sum by (method) (rate(impasto_attempt_seconds_total{RATE}))", "{{method}}"),
                    stacked=True,
                ),
                graph(
                    "Failures by code",
                    "Failed attempts per second by code. bad-media: a user's file. worker-lost: often lack of memory.",
                    "short",
                    Line(f"sum by (code) (rate(impasto_attempt_failures_total{RATE}))", "{{code}}"),
                    Line("max by (code) (impasto_recent_attempt_failures)", "{{code}}, last 15 min"),
                    stacked=False,
                ),
                graph(
                    "Drained",
                    "Nodes (or the queue) that an operator has drained, so that no new task starts there.",
                    "short",
                    Line("max by (place) (impasto_drained)", "{{place}}"),
                ),
                graph(
                    "Ended jobs",
                    "Ended jobs by final state.",
                    "short",
                    Line('max by (state) (impasto_jobs{state=~"succeeded|failed|cancelled"})', "{{state}}"),
                ),
            ),
        ),
    ),
)
