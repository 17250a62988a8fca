"""Solvers of large sparse systems on the pixel grid."""

from pipeline.solvers.multigrid import Multigrid, Solution, solve_laplace

__all__ = ["Multigrid", "Solution", "solve_laplace"]
