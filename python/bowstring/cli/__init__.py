"""The command `bowstring`: one file for each group of commands."""
