"""Child processes that run the jobs of a study, one after the other, within limits."""
