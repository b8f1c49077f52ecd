"""Test data in: files of a real test to channels in SI units on one uniform clock. Nothing is guessed."""
