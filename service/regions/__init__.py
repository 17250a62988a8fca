"""Where regions are: maps and lists that a job has found."""
