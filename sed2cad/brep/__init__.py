"""The only place that imports OCP and build123d."""
