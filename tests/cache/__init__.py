"""Tests of `tsplat cache`."""
