"""Studies: settings, plan, tasks, jobs; trials, tuning and learning tests."""
