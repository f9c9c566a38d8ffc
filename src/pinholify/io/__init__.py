"""Reading and writing: everything that touches files, and nothing that computes."""
