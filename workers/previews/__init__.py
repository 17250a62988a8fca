"""Previews of projects: warm state at proxy size, answers from coarse to fine, overtaken requests cancelled."""
