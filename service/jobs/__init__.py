"""Jobs and their tasks, events and files."""
