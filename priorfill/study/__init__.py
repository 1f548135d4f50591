"""Fill the recordings of a whole study: jobs that can be continued, shared out, and summarised."""
