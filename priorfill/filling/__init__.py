"""Fill a clip: choose a method, call it, assemble the result, and record what was done."""
