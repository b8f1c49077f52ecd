"""What every page is made of: its frame, its markup, numbers as people read them."""
