"""Projects: documents with versions, jobs made of them, links that show them, archives."""
