"""Interfaces to other libraries, programs and file formats."""
