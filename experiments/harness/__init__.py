"""What every experiment shares: finding it, its result, its progress, its page, its trials."""
