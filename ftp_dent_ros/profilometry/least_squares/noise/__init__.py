"""What of a fitted phase is noise, what windows took of it, and what its deviation is."""
