"""Webhooks: allowed targets, signatures, and the sender."""
