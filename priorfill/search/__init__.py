"""Search: banks of poses, and the exact index over them."""
