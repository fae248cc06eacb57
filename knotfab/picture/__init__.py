"""The target: a picture becomes a silhouette, as a mask and as polygons with holes."""
