"""Command `bowstring`: one file for each group of commands."""
