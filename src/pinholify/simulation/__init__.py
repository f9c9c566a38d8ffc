"""Cameras, scenes and photographs with known truth. Knows nothing of estimation: truth leaves as arrays."""
