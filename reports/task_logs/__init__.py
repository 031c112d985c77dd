"""Work that was driven: runs, comparison with a plan, values learned."""
