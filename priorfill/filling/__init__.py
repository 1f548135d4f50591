"""Fill clips and files: divide gaps among methods, assemble results, and record provenance."""
