"""Studies: many independent cells of work, computed on one machine or many, stored as they finish, and combined."""
