"""Soak test: runs a service under mixed load for hours and measures unwanted growth."""
