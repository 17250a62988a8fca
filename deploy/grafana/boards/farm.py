"""Work, and who does it."""

from __future__ import annotations

from deploy.grafana.panels import RATE, Board, Line, graph, stat

FARM = Board(
    "farm",
    "Farm",
    "Work: what waits, what runs, what fails, and who does it.",
    (
        (
            "Now",
            (
                stat("Tasks ready", "Could run now.", "short", "max(impasto_queue_ready_tasks)"),
                stat(
                    "Oldest queued job",
                    "Its wait; an alert above an hour.",
                    "s",
                    "max(impasto_queue_oldest_seconds)",
                    limits=((600, "yellow"), (3600, "red")),
                ),
                stat("Attempts at work", "In the whole farm.", "short", "max(impasto_attempts_running)"),
                stat(
                    "Workers",
                    "That are there.",
                    "short",
                    "sum(impasto_workers)",
                    limits=((1, "green"),),
                    low_is_bad=True,
                ),
                stat(
                    "Busy",
                    "Of those that are there.",
                    "percentunit",
                    "sum(impasto_workers_busy) / sum(impasto_workers)",
                ),
                stat(
                    "Failed attempts",
                    "Of those that ended; an alert above 10 %.",
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
                    "By state.",
                    "short",
                    Line('max by (state) (impasto_jobs{state=~"queued|running|paused"})', "{{state}}"),
                    stacked=True,
                ),
                graph(
                    "Tasks",
                    "Of all jobs, by state.",
                    "short",
                    Line('max by (state) (impasto_tasks{state=~"waiting|ready|running"})', "{{state}}"),
                    stacked=True,
                ),
                graph(
                    "Wait of the oldest job",
                    "Rises while there is more work than workers.",
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
                    "Frames a second",
                    "Finished, by method.",
                    "short",
                    Line(f"sum by (method) (rate(impasto_frames_total{RATE}))", "{{method}}"),
                    stacked=True,
                ),
                graph(
                    "Attempts",
                    "Ended a second, by outcome. Interrupted: the worker died.",
                    "short",
                    Line(f"sum by (outcome) (rate(impasto_attempts_total{RATE}))", "{{outcome}}"),
                    stacked=True,
                ),
                graph(
                    "Seconds a frame",
                    "Worker time that a frame costs, by method.",
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
                    "Wanted, there and at work.",
                    "short",
                    Line("sum(impasto_workers_wanted)", "wanted"),
                    Line("sum(impasto_workers)", "there"),
                    Line("sum(impasto_workers_busy)", "at work"),
                ),
                graph(
                    "Time at work",
                    "Worker seconds a second, by method.",
                    "short",
                    Line(f"sum by (method) (rate(impasto_attempt_seconds_total{RATE}))", "{{method}}"),
                    stacked=True,
                ),
                graph(
                    "Failures by code",
                    "Of attempts. bad-media is a user's file; worker-lost is often memory.",
                    "short",
                    Line(f"sum by (code) (rate(impasto_attempt_failures_total{RATE}))", "{{code}}"),
                    Line("max by (code) (impasto_recent_attempt_failures)", "{{code}}, last 15 min"),
                    stacked=False,
                ),
                graph(
                    "Drained",
                    "Places that an operator lets start nothing new.",
                    "short",
                    Line("max by (place) (impasto_drained)", "{{place}}"),
                ),
                graph(
                    "Jobs over",
                    "By how they ended.",
                    "short",
                    Line('max by (state) (impasto_jobs{state=~"succeeded|failed|cancelled"})', "{{state}}"),
                ),
            ),
        ),
    ),
)
