"""Skeletons: chains of rotating joints, and virtual markers computed from their motion.

Much freely available motion is published as skeletons (ASF/AMC, BVH), not as markers. Forward
kinematics turns joint angles into positions and rotations of bones, on which markers are placed.
"""
