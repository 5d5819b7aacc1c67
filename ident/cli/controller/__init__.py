"""Commands about a controller: probe, simulate, verify, doctor, export-external."""
