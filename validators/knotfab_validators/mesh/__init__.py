"""Check that a surface is sound: closed, wound outwards, crossing nothing."""
