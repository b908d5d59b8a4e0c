"""What a motion needs of the legs, and how much of the limits it uses."""
