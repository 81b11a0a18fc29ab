"""Fewer, merged splats for the size on screen."""
