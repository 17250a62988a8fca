"""Dashboard of the stores: database, blobs, pool, disks."""

from __future__ import annotations

from deploy.grafana.panels import ONE, RATE, Board, Line, graph, stat

STORES = Board(
    "stores",
    "Stores",
    "Database, blobs, pool and disks.",
    (
        (
            "Now",
            (
                stat(
                    "Components ready",
                    "Share of the components (database, blobs, pool) of all processes that are ready.",
                    "percentunit",
                    f"sum(impasto_ready{{{ONE}}}) / count(impasto_ready{{{ONE}}})",
                    limits=((0.999, "green"),),
                    low_is_bad=True,
                ),
                stat(
                    "Database",
                    "Longest query time of the latest scrape. An alert fires above 1 s.",
                    "s",
                    f"max(impasto_store_answer_seconds{{{ONE}}})",
                    limits=((0.25, "yellow"), (1, "red")),
                ),
                stat(
                    "Least free space",
                    "Free space of the fullest disk that holds blobs.",
                    "bytes",
                    f'min(impasto_disk_free_bytes{{{ONE}, place="blobs"}})',
                ),
                stat(
                    "Free above the reserve",
                    "Free space for new work. At 0, new jobs are refused.",
                    "bytes",
                    f'min(impasto_disk_free_bytes{{{ONE}, place="blobs"}} - on (instance)'
                    f" impasto_disk_reserve_bytes{{{ONE}}})",
                    limits=((1, "yellow"), (4 << 30, "green")),
                    low_is_bad=True,
                ),
            ),
        ),
        (
            "Components",
            (
                graph(
                    "Ready",
                    "1 while a component of a process is ready, otherwise 0.",
                    "bool",
                    Line(f"impasto_ready{{{ONE}}}", "{{instance}} {{part}}"),
                    width=12,
                ),
                graph(
                    "Database",
                    "Time of the database queries of a scrape.",
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
                    "Free space by place. With S3, the place blobs is the disk of their local copies.",
                    "bytes",
                    Line(f"impasto_disk_free_bytes{{{ONE}}}", "{{instance}} {{place}}"),
                    Line(f"max(impasto_disk_reserve_bytes{{{ONE}}})", "reserve"),
                    width=12,
                ),
                graph(
                    "Used",
                    "Used share of each disk.",
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
            "Errors of components",
            (
                graph(
                    "503 and 507",
                    "Refused requests per second: a component was unavailable (503), or a disk was full (507).",
                    "reqps",
                    Line(
                        f'sum by (status) (rate(impasto_http_requests_total{{{ONE}, status=~"503|507"}}{RATE}))',
                        "{{status}}",
                    ),
                    width=12,
                ),
                graph(
                    "Storage failures",
                    "Failed attempts per second with a storage error. Attempts that find a store unavailable are "
                    "postponed and not counted here.",
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
