"""`impasto batch`: the shots of a cut, a manifest or a folder, painted one by one into versions that are kept."""
