"""Where results go: disparity files, point clouds, pictures, JSON lines."""
