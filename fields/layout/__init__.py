"""Swaths and headland passes: bearings worth trying, cells, parallel lines and complete layouts."""
