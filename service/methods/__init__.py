"""The methods there are."""
