"""Motion-BIDS: recordings as tables without a header, and the files that describe them."""
