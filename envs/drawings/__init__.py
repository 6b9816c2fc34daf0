"""The pictures of the finite tasks, one module a task."""
