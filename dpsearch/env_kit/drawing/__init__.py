"""The canvas that pictures of tasks are painted on, their common frame, and their colours."""
