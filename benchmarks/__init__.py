"""Measurements that are compared with the paper's; ``python -m benchmarks`` prints them."""
