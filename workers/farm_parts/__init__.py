"""The nouns of a `Farm`: `farm.assets`, `farm.jobs`, `farm.tasks`, `farm.files`, and its health checks."""
