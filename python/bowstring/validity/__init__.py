"""Where constant curvature holds: maps over designs and loads."""
