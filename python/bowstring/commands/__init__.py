"""The commands of `bowstring`, one file for each group; `bowstring.cli` is the process."""
