"""What stages share: cameras, mesh, footprint samples, environment map, emitters, segments, shading."""
