"""Preview a picture in a second: its silhouette, what tubes lose of it, size, hours and grams."""
