"""Video files (extra ``video``): read frame by frame, remapped plane by plane, encoded in parts and assembled."""
