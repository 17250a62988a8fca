"""Metrics, health, and control of the farm for operators."""
