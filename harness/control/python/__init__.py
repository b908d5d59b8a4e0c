"""Controllers of the user in Python: how they are made, what they are told, what they may share."""
