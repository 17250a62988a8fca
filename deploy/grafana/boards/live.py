"""Live sessions."""

from __future__ import annotations

from deploy.grafana.panels import BAD, ONE, RATE, Board, Line, graph, quantiles, stat

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
