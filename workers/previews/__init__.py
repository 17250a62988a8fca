"""Previews of projects: cached state at proxy size, answers from coarse to fine; a newer request cancels older ones."""
