"""Dashboard of the HTTP service: requests, errors, latency, processes."""

from __future__ import annotations

from deploy.grafana.panels import ASKED, ONE, RATE, Board, Line, graph, quantiles, stat

SERVICE = Board(
    "service",
    "Service",
    "Requests, errors, latency and webhooks of the HTTP service.",
    (
        (
            "Now",
            (
                stat(
                    "Up",
                    "Service processes that answer Prometheus.",
                    "short",
                    'count(up{job="impasto"} == 1)',
                    limits=((1, "green"),),
                    low_is_bad=True,
                ),
                stat(
                    "Requests",
                    "All requests per second.",
                    "reqps",
                    f"sum(rate(impasto_http_requests_total{{{ONE}}}{RATE}))",
                ),
                stat(
                    "Server errors",
                    "Share of 5xx responses except 503 and 507 (separate alerts). An alert fires above 2 %.",
                    "percentunit",
                    f'sum(rate(impasto_http_requests_total{{{ONE}, status=~"5..", status!~"503|507"}}{RATE}))'
                    f" / sum(rate(impasto_http_requests_total{{{ONE}}}{RATE})) or vector(0)",
                    limits=((0.005, "yellow"), (0.02, "red")),
                ),
                stat(
                    "Latency, p99",
                    "Time to the start of the response, without uploads, images and results. An alert fires above 1 s.",
                    "s",
                    quantiles("impasto_http_request_duration_seconds", ASKED)[2].expr,
                    limits=((0.1, "yellow"), (1, "red")),
                ),
                stat("Event streams", "Open event streams.", "short", f"sum(impasto_event_streams{{{ONE}}})"),
                stat(
                    "Webhooks waiting",
                    "Undelivered messages in the outbox. An alert fires above 200.",
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
                    "Requests per second by status. 4xx: errors of clients. 5xx: errors of the service.",
                    "reqps",
                    Line(f"sum by (status) (rate(impasto_http_requests_total{{{ONE}}}{RATE}))", "{{status}}"),
                    stacked=True,
                ),
                graph(
                    "By route",
                    "Requests per second of the ten busiest routes.",
                    "reqps",
                    Line(f"topk(10, sum by (route) (rate(impasto_http_requests_total{{{ONE}}}{RATE})))", "{{route}}"),
                ),
                graph(
                    "Errors by route",
                    "5xx responses per second of every route that returned any.",
                    "reqps",
                    Line(
                        f'sum by (route, status) (rate(impasto_http_requests_total{{{ONE}, status=~"5.."}}{RATE})) > 0',
                        "{{route}} {{status}}",
                    ),
                ),
                graph(
                    "Latency",
                    "Time to the start of the response, without uploads, images and results.",
                    "s",
                    *quantiles("impasto_http_request_duration_seconds", ASKED),
                ),
                graph(
                    "p99 by route",
                    "Latency of the ten slowest routes, including uploads and images.",
                    "s",
                    Line(
                        "topk(10, histogram_quantile(0.99, sum by (le, route) (rate("
                        f"impasto_http_request_duration_seconds_bucket{{{ONE}}}{RATE}))))",
                        "{{route}}",
                    ),
                ),
                graph(
                    "Refused",
                    "Refused requests per second: no valid key (401), forbidden (403), too large (413), "
                    "rate limit (429), disk full (507).",
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
                    "Processor cores that each API process uses, including its local workers.",
                    "short",
                    Line(f'rate(process_cpu_seconds_total{{job="impasto", {ONE}}}{RATE})', "{{instance}}"),
                ),
                graph(
                    "Memory",
                    "Resident set size of each API process.",
                    "bytes",
                    Line(f'process_resident_memory_bytes{{job="impasto", {ONE}}}', "{{instance}}"),
                ),
                graph(
                    "Open files",
                    "Open file descriptors. A line that only rises indicates a leak.",
                    "short",
                    Line(f'process_open_fds{{job="impasto", {ONE}}}', "{{instance}}"),
                    Line(f'min(process_max_fds{{job="impasto", {ONE}}})', "limit"),
                ),
                graph(
                    "Versions",
                    "Processes by version. More than one version means that an upgrade is in progress or incomplete.",
                    "short",
                    Line("count by (version) (impasto_build_info)", "{{version}}"),
                    stacked=True,
                ),
                graph(
                    "Uptime",
                    "Time since each process started.",
                    "s",
                    Line(f'time() - process_start_time_seconds{{job="impasto", {ONE}}}', "{{instance}}"),
                ),
            ),
        ),
    ),
)
