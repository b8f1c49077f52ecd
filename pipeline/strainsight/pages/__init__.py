"""Figures and HTML pages from records and arrays, without computing results."""
