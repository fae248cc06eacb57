"""What a picture will become, in a second: its silhouette, what tubes lose of it, size, hours and grams."""
