"""Everything that reads and writes files; conversions to and from other camera models fit splines here too."""
