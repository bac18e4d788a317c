"""What a trained policy does, and what its options are for."""
