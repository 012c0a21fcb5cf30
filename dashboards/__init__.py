"""Reads a store and shows it: the Rerun timeline and the report."""
