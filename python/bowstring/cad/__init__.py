"""The robot as a solid: CAD files, a rendered picture, drawings of its disks."""
