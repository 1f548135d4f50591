"""Skeletons: joints that turn in each other, and marker sets placed on them.

Free libraries of motion come as skeletons (ASF/AMC, BVH), not as markers. Here a skeleton's joint
angles become positions and rotations of its bones, and a marker set is placed on these.
"""
