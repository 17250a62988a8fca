"""The four dashboards: service, farm, live, stores.

Gauges that come from the database are the same from every API process and are joined by max; what a process counts of
itself is summed.
"""

from __future__ import annotations

from deploy.grafana.panels import Board, Line, graph, quantiles, stat

ONE = 'instance=~"$instance"'
RATE = "[$__rate_interval]"
BAD = ((1.0, "red"),)
ASKED = f'{ONE}, route!~".*(uploads|assets|previews|frame|thumbnail|result|files|content|regions|metrics|readyz).*"'
"""Questions, as the alert ImpastoSlow has them: uploads and pictures are work."""

SERVICE = Board(
    "service",
    "Service",
    "What clients see: requests, errors, waits, webhooks.",
    (
        (
            "Now",
            (
                stat(
                    "Up",
                    "Processes that answer.",
                    "short",
                    'count(up{job="impasto"} == 1)',
                    limits=((1, "green"),),
                    low_is_bad=True,
                ),
                stat(
                    "Requests",
                    "A second, of all kinds.",
                    "reqps",
                    f"sum(rate(impasto_http_requests_total{{{ONE}}}{RATE}))",
                ),
                stat(
                    "Our errors",
                    "Of all requests; an alert above 2 %. 503 and 507 have alerts of their own.",
                    "percentunit",
                    f'sum(rate(impasto_http_requests_total{{{ONE}, status=~"5..", status!~"503|507"}}{RATE}))'
                    f" / sum(rate(impasto_http_requests_total{{{ONE}}}{RATE})) or vector(0)",
                    limits=((0.005, "yellow"), (0.02, "red")),
                ),
                stat(
                    "p99 of questions",
                    "Uploads, pictures and results not counted; an alert above 1 s.",
                    "s",
                    quantiles("impasto_http_request_duration_seconds", ASKED)[2].expr,
                    limits=((0.1, "yellow"), (1, "red")),
                ),
                stat("Event streams", "Open now.", "short", f"sum(impasto_event_streams{{{ONE}}})"),
                stat(
                    "Webhooks waiting",
                    "In the outbox; an alert above 200.",
                    "short",
                    "max(impasto_webhooks_waiting)",
                    limits=((50, "yellow"), (200, "red")),
                ),
            ),
        ),
        (
            "Requests",
            (
                graph(
                    "By status",
                    "4xx is what clients did, 5xx is ours.",
                    "reqps",
                    Line(f"sum by (status) (rate(impasto_http_requests_total{{{ONE}}}{RATE}))", "{{status}}"),
                    stacked=True,
                ),
                graph(
                    "By route",
                    "The ten busiest.",
                    "reqps",
                    Line(f"topk(10, sum by (route) (rate(impasto_http_requests_total{{{ONE}}}{RATE})))", "{{route}}"),
                ),
                graph(
                    "Errors by route",
                    "Every route that gave a 5xx.",
                    "reqps",
                    Line(
                        f'sum by (route, status) (rate(impasto_http_requests_total{{{ONE}, status=~"5.."}}{RATE})) > 0',
                        "{{route}} {{status}}",
                    ),
                ),
                graph(
                    "Wait for an answer",
                    "Of questions; to the start of the answer.",
                    "s",
                    *quantiles("impasto_http_request_duration_seconds", ASKED),
                ),
                graph(
                    "p99 by route",
                    "The ten slowest, uploads and pictures too.",
                    "s",
                    Line(
                        "topk(10, histogram_quantile(0.99, sum by (le, route) (rate("
                        f"impasto_http_request_duration_seconds_bucket{{{ONE}}}{RATE}))))",
                        "{{route}}",
                    ),
                ),
                graph(
                    "Refused",
                    "Without a key (401), not allowed (403), too much (429), full (507).",
                    "reqps",
                    Line(
                        "sum by (status) (rate(impasto_http_requests_total"
                        f'{{{ONE}, status=~"401|403|413|429|507"}}{RATE}))',
                        "{{status}}",
                    ),
                    stacked=True,
                ),
            ),
        ),
        (
            "Processes",
            (
                graph(
                    "CPU",
                    "Cores in use, of each API process (with local workers: theirs as well).",
                    "short",
                    Line(f'rate(process_cpu_seconds_total{{job="impasto", {ONE}}}{RATE})', "{{instance}}"),
                ),
                graph(
                    "Memory",
                    "Resident.",
                    "bytes",
                    Line(f'process_resident_memory_bytes{{job="impasto", {ONE}}}', "{{instance}}"),
                ),
                graph(
                    "Open files",
                    "A line that only rises is a leak.",
                    "short",
                    Line(f'process_open_fds{{job="impasto", {ONE}}}', "{{instance}}"),
                    Line(f'min(process_max_fds{{job="impasto", {ONE}}})', "limit"),
                ),
                graph(
                    "Versions",
                    "More than one is an upgrade under way, or one that stopped half-way.",
                    "short",
                    Line("count by (version) (impasto_build_info)", "{{version}}"),
                    stacked=True,
                ),
                graph(
                    "Age",
                    "Since each process began.",
                    "s",
                    Line(f'time() - process_start_time_seconds{{job="impasto", {ONE}}}', "{{instance}}"),
                ),
            ),
        ),
    ),
)

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

LIVE = Board(
    "live",
    "Live",
    "Live sessions: how many, how late, how much is dropped.",
    (
        (
            "Now",
            (
                stat("Sessions", "Open now.", "short", f"sum(impasto_live_sessions{{{ONE}}})"),
                stat(
                    "Frames",
                    "Painted a second.",
                    "short",
                    f'sum(rate(impasto_live_frames_total{{{ONE}, outcome="painted"}}{RATE}))',
                ),
                stat(
                    "p95",
                    "From a frame received to its answer sent; an alert above 200 ms.",
                    "s",
                    quantiles("impasto_live_latency_seconds", ONE)[1].expr,
                    limits=((0.1, "yellow"), (0.2, "red")),
                ),
                stat(
                    "Dropped",
                    "Of the frames received; an alert above half.",
                    "percentunit",
                    f'sum(rate(impasto_live_frames_total{{{ONE}, outcome="dropped"}}{RATE}))'
                    f' / sum(rate(impasto_live_frames_total{{{ONE}, outcome="received"}}{RATE})) or vector(0)',
                    limits=((0.2, "yellow"), (0.5, "red")),
                ),
                stat(
                    "Workers lost",
                    "Within the hour.",
                    "short",
                    f"sum(increase(impasto_live_workers_lost_total{{{ONE}}}[1h]))",
                    limits=BAD,
                ),
            ),
        ),
        (
            "Frames",
            (
                graph(
                    "Latency",
                    "From a frame fully received to its answer sent.",
                    "s",
                    *quantiles("impasto_live_latency_seconds", ONE),
                    limits=((0.2, "red"),),
                ),
                graph(
                    "Frames",
                    "A second. Received is painted and dropped together.",
                    "short",
                    Line(f"sum by (outcome) (rate(impasto_live_frames_total{{{ONE}}}{RATE}))", "{{outcome}}"),
                ),
                graph(
                    "Dropped",
                    "Of the frames received. The newest goes first: some are normal under load.",
                    "percentunit",
                    Line(
                        f'sum by (instance) (rate(impasto_live_frames_total{{{ONE}, outcome="dropped"}}{RATE}))'
                        f' / sum by (instance) (rate(impasto_live_frames_total{{{ONE}, outcome="received"}}{RATE}))',
                        "{{instance}}",
                    ),
                    limits=((0.5, "red"),),
                ),
            ),
        ),
        (
            "Sessions",
            (
                graph(
                    "Sessions",
                    "By process: a session belongs to one.",
                    "short",
                    Line(f"impasto_live_sessions{{{ONE}}}", "{{instance}}"),
                    stacked=True,
                ),
                graph(
                    "Workers lost",
                    "Under a live session; it goes on within a second.",
                    "short",
                    Line(f"increase(impasto_live_workers_lost_total{{{ONE}}}{RATE})", "{{instance}}"),
                ),
                graph(
                    "Slow frames",
                    "Answers that took more than 100 ms, a second.",
                    "short",
                    Line(
                        f"sum(rate(impasto_live_latency_seconds_count{{{ONE}}}{RATE}))"
                        f' - sum(rate(impasto_live_latency_seconds_bucket{{{ONE}, le="0.1"}}{RATE}))',
                        "slow",
                    ),
                ),
            ),
        ),
    ),
)

STORES = Board(
    "stores",
    "Stores",
    "Database, blobs, pool and disks.",
    (
        (
            "Now",
            (
                stat(
                    "Parts that work",
                    "Of all parts of all processes.",
                    "percentunit",
                    f"sum(impasto_ready{{{ONE}}}) / count(impasto_ready{{{ONE}}})",
                    limits=((0.999, "green"),),
                    low_is_bad=True,
                ),
                stat(
                    "Database",
                    "The longest answer to a scrape; an alert above 1 s.",
                    "s",
                    f"max(impasto_store_answer_seconds{{{ONE}}})",
                    limits=((0.25, "yellow"), (1, "red")),
                ),
                stat(
                    "Least free",
                    "Of the disks that blobs are on.",
                    "bytes",
                    f'min(impasto_disk_free_bytes{{{ONE}, place="blobs"}})',
                ),
                stat(
                    "Above the reserve",
                    "Room for new work; at 0 it is refused.",
                    "bytes",
                    f'min(impasto_disk_free_bytes{{{ONE}, place="blobs"}} - on (instance)'
                    f" impasto_disk_reserve_bytes{{{ONE}}})",
                    limits=((1, "yellow"), (4 << 30, "green")),
                    low_is_bad=True,
                ),
            ),
        ),
        (
            "Parts",
            (
                graph(
                    "Ready",
                    "1 where a part works.",
                    "bool",
                    Line(f"impasto_ready{{{ONE}}}", "{{instance}} {{part}}"),
                    width=12,
                ),
                graph(
                    "Database",
                    "How long it took for the figures of a scrape.",
                    "s",
                    Line(f"impasto_store_answer_seconds{{{ONE}}}", "{{instance}}"),
                    limits=((1, "red"),),
                    width=12,
                ),
            ),
        ),
        (
            "Disks",
            (
                graph(
                    "Free",
                    "By place; with S3 the place of blobs is that of their copies.",
                    "bytes",
                    Line(f"impasto_disk_free_bytes{{{ONE}}}", "{{instance}} {{place}}"),
                    Line(f"max(impasto_disk_reserve_bytes{{{ONE}}})", "reserve"),
                    width=12,
                ),
                graph(
                    "Used",
                    "Of each disk.",
                    "percentunit",
                    Line(
                        f"1 - impasto_disk_free_bytes{{{ONE}}} / impasto_disk_size_bytes{{{ONE}}}",
                        "{{instance}} {{place}}",
                    ),
                    limits=((0.8, "yellow"), (0.95, "red")),
                    width=12,
                ),
            ),
        ),
        (
            "Refusals for want of a part",
            (
                graph(
                    "503 and 507",
                    "Requests that met a part that was away, or a disk that was full.",
                    "reqps",
                    Line(
                        f'sum by (status) (rate(impasto_http_requests_total{{{ONE}, status=~"503|507"}}{RATE}))',
                        "{{status}}",
                    ),
                    width=12,
                ),
                graph(
                    "Failures of stores",
                    "Attempts that met an absent store are put off and charged to nobody; these are others.",
                    "short",
                    Line(
                        f'sum by (code) (rate(impasto_attempt_failures_total{{code=~"storage.*|not-found"}}{RATE}))',
                        "{{code}}",
                    ),
                    width=12,
                ),
            ),
        ),
    ),
)

BOARDS = (SERVICE, FARM, LIVE, STORES)
