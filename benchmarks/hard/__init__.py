"""The catalogue of hard cases: small generators, each with a line on why it is hard."""
