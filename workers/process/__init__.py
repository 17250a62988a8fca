"""The process that everything runs in: its descriptors, memory, start and log."""
