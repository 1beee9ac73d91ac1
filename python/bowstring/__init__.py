"""Is constant curvature good enough for my cable-driven continuum robot?"""
