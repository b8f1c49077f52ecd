"""Fatigue damage of stress histories: cycles, S-N curve, Miner's sum, and its interval over draws."""
