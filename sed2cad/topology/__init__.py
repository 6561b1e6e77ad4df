"""From fitted patches to regions, chains and corners."""
