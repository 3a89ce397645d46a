"""``python -m benchmarks``: the paper's Table II."""

from benchmarks.table2 import main

main()
