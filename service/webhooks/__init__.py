"""Webhooks: who may be told, how it is signed, and the sender."""
