"""Search: banks of poses and the kd-trees over them."""
