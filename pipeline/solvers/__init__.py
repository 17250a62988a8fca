"""Solvers of large sparse systems on the pixel grid."""

from pipeline.solvers.multigrid import Multigrid, Solution

__all__ = ["Multigrid", "Solution"]
