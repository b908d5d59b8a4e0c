"""What is to be released, as its users will have it: built from a clean clone, in empty environments."""
