"""A build: from a call to a folder of files that were verified."""
