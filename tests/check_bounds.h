// Included before every kernel compiled for a CPU under --debug-kernels. Warp compiles in release mode with NDEBUG, which
// turns the checks of indices in its own headers off.
#undef NDEBUG
