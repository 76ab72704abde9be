//! Cameras and rigs: what an image taken at a pose can see.
