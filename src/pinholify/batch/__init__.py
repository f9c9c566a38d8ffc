"""Batch processing of pictures and videos: planning, execution in one or more processes or a cluster, results."""
