"""Numbers, pages and figures from results."""
