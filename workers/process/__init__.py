"""Settings of the process itself: descriptors, memory, start and logs."""
