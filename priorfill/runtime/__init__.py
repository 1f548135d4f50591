"""Threads, file locks, packaged resource files, and files written atomically."""
