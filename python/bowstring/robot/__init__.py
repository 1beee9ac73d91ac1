"""What a robot is: the model and its file, checks, built-in robots."""
