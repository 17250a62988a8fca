"""The async client, and the source of the sync one: `python client/make_sync.py` writes `_sync` from these files."""
