"""Live sessions: frames arrive at camera rate, painted frames go back, the newest frame first.

    model          messages: orders, frame requests, painted frames
    policy         which frame is painted next                   pure
    resolution     at which size                                 pure
    statistics     counts and percentiles                        pure
    codecs         frames to bytes and back
    renderer       the work of one session
    worker         the interface of a worker; `local_workers`: threads of this process; `ray_workers`: a Ray actor each
    channel        frames to a worker in another process
    stream         one session: policy, resolution, and a worker that may die
    sessions       all sessions of a service

The protocol is `docs/live.md`. The pure modules use no threads, no event loop and no clock: times are arguments.
"""
