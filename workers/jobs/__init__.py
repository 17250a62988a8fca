"""Rules of jobs, independent of storage: states and transitions, warnings, and the rendered range of the video."""
