"""What everything is kept in."""

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
