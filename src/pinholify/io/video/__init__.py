"""Video files (extra ``video``): read frame by frame, remapped plane by plane, written in parts and put together."""
