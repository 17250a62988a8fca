"""The laws of docs/testing.md ("Laws"), checked on generated cases: see `tests.laws.cases`."""
