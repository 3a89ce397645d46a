"""The simulation: plan, state and stages."""
