"""Made from `_async` by client/make_sync.py: do not edit."""
