"""Dashboard of live sessions: frame rate, latency, drops."""

from __future__ import annotations

from deploy.grafana.panels import BAD, ONE, RATE, Board, Line, graph, quantiles, stat

LIVE = Board(
    "live",
    "Live",
    "Number, latency and dropped frames of live sessions.",
    (
        (
            "Now",
            (
                stat("Sessions", "Live sessions that are open now.", "short", f"sum(impasto_live_sessions{{{ONE}}})"),
                stat(
                    "Frames",
                    "Painted frames per second, all sessions.",
                    "short",
                    f'sum(rate(impasto_live_frames_total{{{ONE}, outcome="painted"}}{RATE}))',
                ),
                stat(
                    "Latency, p95",
                    "Time from the receipt of a frame to the sending of its painting. An alert fires above 200 ms.",
                    "s",
                    quantiles("impasto_live_latency_seconds", ONE)[1].expr,
                    limits=((0.1, "yellow"), (0.2, "red")),
                ),
                stat(
                    "Dropped",
                    "Share of the received frames that were dropped. An alert fires above 50 %.",
                    "percentunit",
                    f'sum(rate(impasto_live_frames_total{{{ONE}, outcome="dropped"}}{RATE}))'
                    f' / sum(rate(impasto_live_frames_total{{{ONE}, outcome="received"}}{RATE})) or vector(0)',
                    limits=((0.2, "yellow"), (0.5, "red")),
                ),
                stat(
                    "Workers lost",
                    "Live workers that crashed within the last hour.",
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
                    "Time from the complete receipt of a frame to the sending of its painting.",
                    "s",
                    *quantiles("impasto_live_latency_seconds", ONE),
                    limits=((0.2, "red"),),
                ),
                graph(
                    "Frames",
                    "Frames per second by outcome. Received frames are the sum of painted and dropped ones.",
                    "short",
                    Line(f"sum by (outcome) (rate(impasto_live_frames_total{{{ONE}}}{RATE}))", "{{outcome}}"),
                ),
                graph(
                    "Dropped",
                    "Share of received frames. The newest frame is painted first: some drops are normal under load.",
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
                    "Open sessions by process. Each session belongs to one process.",
                    "short",
                    Line(f"impasto_live_sessions{{{ONE}}}", "{{instance}}"),
                    stacked=True,
                ),
                graph(
                    "Workers lost",
                    "Workers that crashed during a session. It continues on another worker within a second.",
                    "short",
                    Line(f"increase(impasto_live_workers_lost_total{{{ONE}}}{RATE})", "{{instance}}"),
                ),
                graph(
                    "Slow frames",
                    "Frames per second whose latency was more than 100 ms.",
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
