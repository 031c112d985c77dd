"""Catalogues of translated texts, one PO file per language; the English text is the key."""
