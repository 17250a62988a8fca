"""What clients see."""

from __future__ import annotations

from deploy.grafana.panels import ASKED, ONE, RATE, Board, Line, graph, quantiles, stat

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
