"""The trade of speed for accuracy: what a setting errs, beside what it costs."""
