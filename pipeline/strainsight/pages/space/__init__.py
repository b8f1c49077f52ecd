"""The structure to turn round on a page: what is drawn, how it is packed, and the script that draws it."""
