"""knotfab: a picture becomes a knotted tube whose shadow is that picture, proved before printing."""

__version__ = "0.1.0"
