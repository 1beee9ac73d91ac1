"""Solid of a robot: CAD files, a rendered picture, drawings of its disks."""
