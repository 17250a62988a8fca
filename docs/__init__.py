"""Scripts that make figures and generated pages, such as `python -m docs.make_gallery`."""
