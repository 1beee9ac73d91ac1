"""The robot as 3-D bricks in CalculiX; `bowstring.finite_elements` has what users import."""
