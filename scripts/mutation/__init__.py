"""Mutation testing: fault sites, the tests that reach them, and runs in private copies."""
