"""Live sessions: frames in at camera rate, frames out, the newest first.

    model        what travels: orders, work, answers
    policy       which frame next                               pure
    resolution   at which size                                  pure
    figures      counts and percentiles                         pure
    codecs       frames to bytes and back
    painter      the work of one session, wherever it runs
    seats        where a session's work runs; `local_seats`: threads here; `workers.live.ray_workers`: a Ray actor each
    stream       one session: policy and resolution over a seat that may die
    live         what a service sees of all this

The protocol is `docs/live.md`. The pure modules are told the time and know no threads, no loop and no clock.
"""
