"""Programs: tables and figures of the thesis, and benchmarks."""
