"""Campaigns: many random trials, too slow for the tests, resumable.

See docs/verification/campaigns.md.
"""
