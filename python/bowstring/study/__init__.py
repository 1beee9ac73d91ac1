"""Is constant curvature good enough: comparisons, error budgets, verdict, report."""
