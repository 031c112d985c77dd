"""Which effects the logs speak for, and what an error without a name depends on."""
