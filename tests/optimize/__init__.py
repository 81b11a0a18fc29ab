"""Tests of `tsplat optimize`."""
