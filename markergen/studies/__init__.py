"""Studies: many independent cells of work, computed on one machine or many, kept as they finish, and put together."""
