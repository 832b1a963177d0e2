"""What users call: each function takes what they have, whether an object, a path or a text, and returns a result."""
