"""Skeleton motions: ASF/AMC, BVH."""
