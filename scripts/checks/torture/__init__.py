"""Parts of the checks that kill writers: faults, processes, plans, readers."""
