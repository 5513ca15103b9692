"""One material and one radiance a part, by gradients of path tracing: what was first called inverse path tracing."""
