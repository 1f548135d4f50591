"""Threads, worker processes, resource files, and files written atomically."""
