"""Hostile bytes are decoded in a child process: it may hang, crash or want all memory, and we go on.

nursery   our side: a process beside ours with the decoders imported, that forks children quickly; one child at work
child     the nursery's entry
roles     its loop, and what children do: one role on one file, within limits, then they end
wire      what is said between us: JSON, and arrays in shared memory; never pickle
reader    `GuardedReader`, the face of a `VideoReader` whose work a child does
files     numbered images, and joining with the source's sound
pictures  pictures of a shot, EXR among them
"""
