"""What makes one layout better than another: a criterion a file, all of them in `choices`."""
