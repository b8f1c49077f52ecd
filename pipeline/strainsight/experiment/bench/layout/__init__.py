"""What the placement on a bench is made of: pool, linear bench, layouts."""
