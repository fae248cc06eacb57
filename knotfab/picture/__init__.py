"""The target: a picture becomes a silhouette, as a raster and as polygons with holes."""
