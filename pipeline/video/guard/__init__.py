"""Hostile bytes are decoded in a child process: it may hang, crash or want all memory, and we go on.

nursery   one process beside ours, with the decoders imported and nothing else to do: it forks children, quickly
child     what a child does: one role on one file, within limits, then it ends
wire      what is said between us: JSON, and arrays in shared memory; never pickle
reader    `GuardedReader`, the face of a `VideoReader` whose work a child does
"""
