"""Commands about measurements: read, new, discover, iso230."""
