"""Surfaces with closed-form truth, for the simulated rig and for tests."""
