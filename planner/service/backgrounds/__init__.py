"""Backgrounds of maps: pictures of the earth from a tile server, an MBTiles file or a GeoTIFF, and where they lie."""
