//! Distances and lines of sight to the surfaces of a scene.
