"""``python -m benchmarks.peers``."""

from benchmarks.peers.motion import main

main()
