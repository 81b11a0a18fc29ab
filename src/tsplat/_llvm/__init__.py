"""What the words for kernels are as instructions; only imported when something is compiled."""

from tsplat._llvm import bits, lanes, moves, threads

__all__ = ["bits", "lanes", "moves", "threads"]
