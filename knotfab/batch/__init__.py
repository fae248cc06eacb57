"""Many pictures: a build each, side by side on this machine or on a cluster."""
