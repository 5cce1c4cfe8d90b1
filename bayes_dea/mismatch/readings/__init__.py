"""What readings show by themselves, and other ways to read a campaign: holds, specimens, gains, limits, slips."""
