"""Other libraries, programs and file formats that robots and runs are handed to."""
