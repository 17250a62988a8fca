"""What all routes share: the service's objects, the caller of a request, and the load of the machine."""
